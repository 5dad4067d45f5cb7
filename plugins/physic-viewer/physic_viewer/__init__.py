"""Results in the browser: the page ``report.html``, and the live view of ``physic view``."""

from __future__ import annotations

from physic_core import CommandRecord, hookimpl

__all__: list[str] = []


@hookimpl
def physic_commands() -> list[CommandRecord]:
    """Return the command "view"."""
    return [CommandRecord("view", "physic_viewer.command:view", "Show results live in the browser, side by side.")]
