"""Stage 2: the 3D points of each person in the metric scene (paper Sec. 3.2).

The point map of the original photo is aligned to the scene on the background. OpenCV camera frame, metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.placement.method import PlacementMethod
from physic_core.engine.scene.solve import SceneState
from physic_core.geometry.alignment import Alignment, apply_alignment, fit_alignment
from physic_core.geometry.pointmap import depth_to_pointmap
from physic_core.geometry.tensors import all_finite
from physic_core.types import AffineAmbiguity

MIN_POINTMAP_INLIER_SHARE = 0.5
"""Minimum inlier share of a reliable alignment."""

FAR_M = 50.0
"""Maximum background depth used by the alignment, metres."""

_MARGIN_PX = 8


@dataclass(frozen=True)
class PhotoPoints:
    """Point map of the original photo.

    Attributes:
        points: (H, W, 3) any unit.
        valid: (H, W) bool.
        unknown: its ambiguity relative to the scene: scale, or scale and z-shift.
        people: (H, W) bool, pixels of all people.
    """

    points: Tensor
    valid: Tensor
    unknown: AffineAmbiguity
    people: Tensor


@dataclass(frozen=True)
class AlignedPhoto:
    """Point map of the original photo, aligned to the scene.

    Attributes:
        alignment: of its background to the scene.
        points: (H, W, 3) metres; all NaN if no background pixel agrees.
        valid: (H, W) bool.
        people: per person (M_i, 3) metres, human points.
    """

    alignment: Alignment
    points: Tensor
    valid: Tensor
    people: tuple[Tensor, ...]

    @property
    def depth(self) -> Tensor:
        """Depth map (H, W), metres along z, NaN where unknown."""
        return torch.where(self.valid & all_finite(self.points), self.points[..., 2], torch.nan)


def align_photo(photo: PhotoPoints, scene: SceneState, masks: Tensor, method: PlacementMethod) -> AlignedPhoto:
    """Align the photo to the metric scene, and select the points of people with masks (B, H, W) bool."""
    alignment = align_photo_points_to_scene(photo, scene.points, scene.valid, method, far=FAR_M)
    aligned = move_photo_points_to_scene(photo.points, alignment, scene.K)
    people = tuple(human_points(aligned, photo.valid, mask, method) for mask in masks)
    return AlignedPhoto(alignment, aligned, photo.valid, people)


def align_photo_points_to_scene(
    photo: PhotoPoints,
    scene_points: Tensor,
    scene_valid: Tensor,
    method: PlacementMethod | None = None,
    far: float = math.inf,
) -> Alignment:
    """Align the original photo's point map to the scene's point map on background pixels (Eq. 1).

    Args:
        photo: point map of the original photo.
        scene_points: (H, W, 3) point map of the scene, any unit.
        scene_valid: (H, W) bool.
        method: of stage 2; that of preset "default" if None.
        far: largest depth of scene pixels used, in the unit of the scene; ``FAR_M`` for a metric scene.

    Returns:
        The alignment; ``inlier_share`` is 0 without common pixels.
    """
    method = method or PlacementMethod()
    background = ~method.grow_mask(photo.people) & (scene_points[..., 2] <= far)
    return fit_alignment(
        photo.points,
        scene_points,
        photo.valid & scene_valid & background,
        photo.unknown,
        options=method.alignment,
        weight=method.weigh_background(photo.points[..., 2], photo.valid, photo.people, background),
    )


def move_photo_points_to_scene(points: Tensor, alignment: Alignment, K: Tensor | None) -> Tensor:
    """Apply the alignment to the original photo's point map; if ``K`` (3, 3) is given, move points onto rays of ``K``.

    Returns:
        (H, W, 3) metres; NaN if the alignment has no inliers, since the distance of people is then unknown.
    """
    if alignment.inlier_share == 0:
        return torch.full_like(points, math.nan)
    aligned = apply_alignment(points, alignment)
    return aligned if K is None else depth_to_pointmap(aligned[..., 2], K)


def human_points(points: Tensor, valid: Tensor, mask: Tensor, method: PlacementMethod | None = None) -> Tensor:
    """Return the points of one person, without depth edges and outliers.

    Args:
        points: (H, W, 3) metres, of the original photo, aligned to the scene.
        valid: (H, W) bool.
        mask: (H, W) bool, the person's visible pixels.
        method: of stage 2; that of preset "default" if None.

    Returns:
        (M, 3) metres; M = 0 if the mask has no valid point.
    """
    box = _box(mask)
    if box is None:
        return points.new_zeros((0, 3))
    cloud, inside = points[box], mask[box]
    known = valid[box] & all_finite(cloud) & (cloud[..., 2] > 0)
    cloud = torch.where(known[..., None], cloud, 0.0)
    return (method or PlacementMethod()).clean_points(cloud, known, inside, mask.shape)


def _box(mask: Tensor) -> tuple[slice, slice] | None:
    """Return rows and columns of a mask's bounding box with a margin, or None for an empty mask."""
    if not bool(mask.any()):
        return None
    spans = []
    for dim, size in ((1, mask.shape[0]), (0, mask.shape[1])):
        hit = mask.any(dim).nonzero()
        spans.append(slice(max(0, int(hit[0]) - _MARGIN_PX), min(size, int(hit[-1]) + 1 + _MARGIN_PX)))
    return spans[0], spans[1]
