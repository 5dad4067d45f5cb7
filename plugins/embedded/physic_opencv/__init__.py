"""Classical OpenCV backends: inpainting; depth, point maps and keypoints of the user's files."""

from __future__ import annotations

from physic_core import PluginItem, hookimpl

__all__: list[str] = []


@hookimpl
def physic_keypoint_readers() -> list[PluginItem]:
    """Return the reader of other programs' keypoints."""
    return [PluginItem("json", "physic_opencv.keypoint_forms:table_of")]
