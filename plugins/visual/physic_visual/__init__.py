"""Pictures of a result: preview, GLB files, and the page in the browser."""

from __future__ import annotations

from physic_core import PluginItem, hookimpl

__all__: list[str] = []


@hookimpl
def physic_pictures() -> list[PluginItem]:
    """Return the maker of a result's pictures."""
    return [PluginItem("visual", "physic_visual.pictures:make_pictures")]
