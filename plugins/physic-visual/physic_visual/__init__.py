"""Pictures of a result: preview, GLB files, and the page in the browser."""

from __future__ import annotations

from physic_core import ExporterRecord, PluginItem, hookimpl

__all__: list[str] = []


@hookimpl
def physic_pictures() -> list[PluginItem]:
    """Return the maker of a result's pictures."""
    return [PluginItem("visual", "physic_visual.pictures:make_pictures")]


@hookimpl
def physic_exporters() -> list[ExporterRecord]:
    """Return the plain GLB file, which physic-export writes with more options."""
    return [
        ExporterRecord(
            "glb",
            (".glb",),
            "physic_visual.glb:export_glb",
            "Blender, Unity, Unreal, three.js",
            "skinned bodies, skeletons, contact, scene, floor, camera",
            stem="skinned",
            gives_way=True,
        )
    ]
