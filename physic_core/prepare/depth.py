"""A depth that was measured: the shape of the scene where it is known."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.engine.scene.measured_shape import shows_people, with_measured_shape

if TYPE_CHECKING:
    from physic_core.types import BoolArray, DepthMap, Intrinsics, Pointmap


def mask_hole(depth: DepthMap, hole: BoolArray) -> DepthMap | None:
    """Return a depth without the pixels (H, W) of a hole; None if none is left."""
    rest = np.where(hole, np.nan, depth.depth)
    return replace(depth, depth=np.asarray(rest, np.float32)) if np.isfinite(rest).any() else None


def scene_with_measured_depth(
    scene: Pointmap, depth: DepthMap, hole: BoolArray, camera: Intrinsics
) -> tuple[Pointmap, str]:
    """Return the scene with the shape of a measured depth, and a note on its share.

    Args:
        scene: point map of the inpainted photo.
        depth: without the hole.
        hole: (H, W), inpainted pixels.
        camera: of a scene that has none.
    """
    scene = with_measured_shape(scene, depth, scene.intrinsics or camera)
    share = (np.isfinite(depth.depth) & scene.valid).sum() / max(1, (scene.valid & ~hole).sum())
    return scene, (
        f"{share:.0%} of the scene have the shape of the given depth, the rest that of the point "
        f"map"
    )


def photo_with_measured_depth(
    photo: Pointmap,
    scene: Pointmap,
    depth: DepthMap,
    behind: DepthMap,
    masks: BoolArray,
    camera: Intrinsics,
) -> Pointmap:
    """Return the point map of the photo with the shape of a measured depth; with that of the
    people, too, if the depth shows them.

    Args:
        photo: with its people.
        scene: without them, of the shape of the depth.
        depth: measured.
        behind: the same without the hole.
        masks: (N, H, W) of the people.
        camera: of a point map that has none.
    """
    photo = with_measured_shape(photo, behind, photo.intrinsics or camera)
    if shows_people(depth, photo, scene, masks):
        photo = with_measured_shape(photo, depth, photo.intrinsics or camera)
        photo = replace(photo, people_farther=None)
    return photo
