"""Results of several methods on data sets with ground truth, and on synthetic worlds."""

from __future__ import annotations

from physic_core import PluginItem, hookimpl

__all__: list[str] = []


@hookimpl
def physic_commands() -> list[PluginItem]:
    """Return the command "evaluate"."""
    return [
        PluginItem(
            "evaluate",
            "physic_bench.evaluate_command:evaluate",
            "Measure results on data sets with ground truth, beside other methods.",
        ),
    ]
