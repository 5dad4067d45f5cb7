"""Classical OpenCV backends: inpainting; depth, point maps and keypoints of the user's files."""

from __future__ import annotations

from physic_core import PluginItem, hookimpl

__all__: list[str] = []


@hookimpl
def physic_keypoint_readers() -> list[PluginItem]:
    """Return the reader of other programs' keypoints."""
    return [PluginItem("json", "physic_opencv.keypoint_files:table_of")]


@hookimpl
def physic_body_readers() -> list[PluginItem]:
    """Return the reader of other programs' bodies."""
    return [PluginItem("tools", "physic_opencv.body_files:bodies_of")]


@hookimpl
def physic_mask_readers() -> list[PluginItem]:
    """Return the reader of other programs' masks."""
    return [PluginItem("tools", "physic_opencv.mask_files:masks_of")]
