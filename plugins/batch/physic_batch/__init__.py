"""Reconstruct many photos: find them, run them in worker processes, keep a journal, and write
tables and pages.

Other packages use ``plan_batch``, ``run_batch`` and ``open_executor`` of :mod:`.run`,
``list_photos`` of :mod:`.photos`, :mod:`.process` for one photo of a batch, :mod:`.workers` for its
processes, :mod:`.journal` with its tables, and :mod:`.contact_sheet`.
"""

from __future__ import annotations

from physic_core import PluginItem, hookimpl

__all__: list[str] = []


@hookimpl
def physic_commands() -> list[PluginItem]:
    """Return the commands "batch" and "report"."""
    return [
        PluginItem(
            "batch",
            "physic_batch.batch_command:batch",
            "Reconstruct many photos in several processes; can resume.",
        ),
        PluginItem(
            "report",
            "physic_batch.report_command:report",
            "Write a result as a page for a browser.",
        ),
    ]
