"""Results in the browser: the page ``report.html``."""

from __future__ import annotations

from physic_core import PluginItem, hookimpl

__all__: list[str] = []


@hookimpl
def physic_pages() -> list[PluginItem]:
    """Return the maker of the page."""
    return [PluginItem("viewer", "physic_viewer.report.page:result_page")]
