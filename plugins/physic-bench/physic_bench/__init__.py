"""Benches: the engine on synthetic worlds, and results of several methods on data sets with ground
truth.
"""

from __future__ import annotations

from physic_core import PluginItem, hookimpl

__all__: list[str] = []


@hookimpl
def physic_commands() -> list[PluginItem]:
    """Return the commands "bench" and "evaluate"."""
    return [
        PluginItem(
            "bench", "physic_bench.bench_command:bench", "Measure the accuracy of the engine."
        ),
        PluginItem(
            "evaluate",
            "physic_bench.evaluate_command:evaluate",
            "Measure results on data sets with ground truth, beside other methods.",
        ),
    ]
