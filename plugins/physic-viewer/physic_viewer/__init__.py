"""Results in the browser: the page ``report.html``, and the live view of ``physic view``."""

from __future__ import annotations

from physic_core import CommandRecord, ReportRecord, hookimpl

__all__: list[str] = []


@hookimpl
def physic_commands() -> list[CommandRecord]:
    """Return the command "view"."""
    return [CommandRecord("view", "physic_viewer.command:view", "Show results live in the browser, side by side.")]


@hookimpl
def physic_reports() -> list[ReportRecord]:
    """Return the page of a result."""
    return [ReportRecord("3d", "physic_viewer.report.page:result_page", "Scene, people and contact in 3D.")]
