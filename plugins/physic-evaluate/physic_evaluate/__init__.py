"""Evaluation as the field measures: data sets with ground truth, results of several methods, tables and plots."""

from __future__ import annotations

from physic_core import CommandRecord, hookimpl

__all__: list[str] = []


@hookimpl
def physic_commands() -> list[CommandRecord]:
    """Return the command "evaluate"."""
    return [
        CommandRecord(
            "evaluate",
            "physic_evaluate.commands:evaluate",
            "Measure results on data sets with ground truth, beside other methods.",
        )
    ]
