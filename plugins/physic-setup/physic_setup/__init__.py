"""Install what plugins need: download their weights, and set up the estimators of a preset."""

from __future__ import annotations

from physic_core import CommandRecord, hookimpl

__all__: list[str] = []


@hookimpl
def physic_commands() -> list[CommandRecord]:
    """Return the commands "setup" and "weights fetch"."""
    return [
        CommandRecord(
            "setup",
            "physic_setup.commands.setup:setup",
            "Print or run the steps that install a preset's estimators.",
        ),
        CommandRecord(
            "weights fetch",
            "physic_setup.commands.fetch:fetch",
            "Download the missing files of weight sets.",
        ),
    ]
