"""Results beside each other, and those of several methods beside ground truth."""

from __future__ import annotations

from physic_core import PluginItem, hookimpl

__all__: list[str] = []


@hookimpl
def physic_commands() -> list[PluginItem]:
    """Return the commands "compare" and "evaluate"."""
    return [
        PluginItem(
            "compare",
            "physic_bench.compare_command:compare",
            "Compare two results, or two folders of results, person by person.",
        ),
        PluginItem(
            "evaluate",
            "physic_bench.evaluate_command:evaluate",
            "Measure results on data sets with ground truth, beside other methods.",
        ),
    ]
