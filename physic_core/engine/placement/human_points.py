"""Stage 2: the 3D points of each person in the metric scene (paper Sec. 3.2).

The point map of the original photo is aligned to the scene on the background. OpenCV camera frame, metres.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from physic_core.engine.placement.settings import PlacementSettings
from physic_core.engine.scene.cleaning import edge_ratio, outlier_mask
from physic_core.engine.scene.settings import OutlierMethod
from physic_core.geometry.alignment import (
    Alignment,
    AlignmentOptions,
    align,
    apply_alignment,
    released_alignment_options,
)
from physic_core.geometry.pointmap import depth_edges, depth_to_pointmap
from physic_core.types import AffineAmbiguity

__all__ = [
    "ALIGN_TOLERANCE",
    "FAR_M",
    "MIN_ALIGN_INLIER_SHARE",
    "align_photo_points_to_scene",
    "human_points",
    "move_photo_points_to_scene",
    "subsample",
]

ALIGN_TOLERANCE = 0.15
"""Largest difference of the two point maps at an inlier, as a share of the depth. Below 0.1, the fit may follow only
one surface."""

MIN_ALIGN_INLIER_SHARE = 0.5
"""Least inlier share of a reliable alignment."""

FAR_M = 50.0
"""Largest depth of background used by the alignment, metres."""

MAX_POINTS = 3000
"""Largest number of points of a person; the time of Eq. 4 is proportional to it."""

_MASK_GROWTH = 0.01  # of the long image side: networks blur depth at the silhouette
_DEPTH_SHARE = 0.15  # standard deviation of the background weight, as a share of the inverse depth range
_FAR_WEIGHT = 0.05  # weight of background far from the people's depth
_MARGIN_PX = 8


def align_photo_points_to_scene(
    points: Tensor,
    valid: Tensor,
    unknown: AffineAmbiguity,
    scene_points: Tensor,
    scene_valid: Tensor,
    people_mask: Tensor,
    settings: PlacementSettings | None = None,
    far: float = math.inf,
) -> Alignment:
    """Align the original photo's point map to the scene's point map on background pixels (Eq. 1).

    Args:
        points: (H, W, 3) point map of the original photo.
        valid: (H, W) bool.
        unknown: its ambiguity relative to the scene: scale, or scale and z-shift.
        scene_points: (H, W, 3) point map of the scene, any unit.
        scene_valid: (H, W) bool.
        people_mask: (H, W) bool, all people.
        settings: of stage 2; preset "default" if None. The robust method dilates the people's mask, and weights
            background by its nearness to the people's depth.
        far: largest depth of scene pixels used, in the unit of the scene; ``FAR_M`` for a metric scene.

    Returns:
        The alignment; ``inlier_share`` is 0 without common pixels.
    """
    settings = settings or PlacementSettings()
    radius = round(_MASK_GROWTH * max(people_mask.shape)) if settings.robust else 0
    background = ~_dilate(people_mask, radius) & (scene_points[..., 2] <= far)
    options, weight = released_alignment_options(ALIGN_TOLERANCE), None
    if settings.robust:
        options = AlignmentOptions(ALIGN_TOLERANCE)
        weight = _nearness_to_people(points[..., 2], valid, people_mask, background)
    return align(
        points,
        valid & background,
        scene_points,
        scene_valid & background,
        unknown,
        options=options,
        weight=weight,
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


def human_points(points: Tensor, valid: Tensor, mask: Tensor, settings: PlacementSettings | None = None) -> Tensor:
    """Return the points of one person, without depth edges and outliers.

    Args:
        points: (H, W, 3) metres, of the original photo, aligned to the scene.
        valid: (H, W) bool.
        mask: (H, W) bool, the person's visible pixels.
        settings: of stage 2; preset "default" if None.

    Returns:
        (M, 3) metres; M = 0 if the mask has no valid point. The robust method takes an even subsample of
        ``MAX_POINTS``.
    """
    settings = settings or PlacementSettings()
    outliers: OutlierMethod = "grid" if settings.robust else "knn"
    box = _box(mask)
    if box is None:
        return points.new_zeros((0, 3))
    rows, columns = mask.shape
    ratio = edge_ratio(outliers, rows, columns)
    cloud, inside = points[box], mask[box]
    known = valid[box] & torch.isfinite(cloud).all(-1) & (cloud[..., 2] > 0)
    cloud = torch.where(known[..., None], cloud, 0.0)
    # Depth edges need pixels outside the mask, as networks mix person and background at its rim.
    own = known & inside & ~depth_edges(cloud[..., 2], known, ratio)
    chosen = cloud[own & ~outlier_mask(cloud, own, outliers, size=(rows, columns))]
    return subsample(chosen, MAX_POINTS) if settings.robust else chosen


def subsample(points: Tensor, count: int) -> Tensor:
    """Return at most ``count`` of points (N, 3), evenly spaced by index."""
    if len(points) <= count:
        return points
    return points[torch.linspace(0, len(points) - 1, count, dtype=torch.float64, device=points.device).round().long()]


def _nearness_to_people(depth: Tensor, valid: Tensor, people: Tensor, background: Tensor) -> Tensor | None:
    """Return the weight (H, W) of background by its difference of inverse depth to people.

    Two point maps of one scene differ by more than an affine map. Without weights, sky and far walls would dominate the
    alignment, and the ground at the feet would be wrong.
    """
    inverse = torch.where(valid & (depth > 0), 1 / depth, 0.0)
    own, others = inverse[people & (inverse > 0)], inverse[background & (inverse > 0)]
    if not len(own) or not len(others):
        return None
    low, high = _quantiles(own, 0.1, 0.9)
    spread = _quantiles(torch.cat((own, others)), 0.01, 0.99)
    extent = spread[1] - spread[0]
    if not extent > 0:
        return None
    gap = torch.maximum(low - inverse, inverse - high).clamp(min=0) / (_DEPTH_SHARE * extent)
    return _FAR_WEIGHT + (1 - _FAR_WEIGHT) * torch.exp(-0.5 * gap.square())


def _quantiles(values: Tensor, low: float, high: float) -> tuple[float, float]:
    """Return two quantiles of values (M,), of a subsample if there are many."""
    some = values[:: max(1, len(values) // 20_000)].double().sort().values
    last = len(some) - 1
    return float(some[round(low * last)]), float(some[round(high * last)])


def _box(mask: Tensor) -> tuple[slice, slice] | None:
    """Return rows and columns of a mask's bounding box with a margin, or None for an empty mask."""
    if not bool(mask.any()):
        return None
    spans = []
    for dim, size in ((1, mask.shape[0]), (0, mask.shape[1])):
        hit = mask.any(dim).nonzero()
        spans.append(slice(max(0, int(hit[0]) - _MARGIN_PX), min(size, int(hit[-1]) + 1 + _MARGIN_PX)))
    return spans[0], spans[1]


def _dilate(mask: Tensor, radius: int) -> Tensor:
    """Dilate a mask (H, W) by a square of ``radius`` px."""
    if radius < 1:
        return mask
    for dim in (0, 1):
        # A pixel is reached if the count of mask pixels rises within the window around it.
        count = torch.nn.functional.pad(mask.cumsum(dim, dtype=torch.int32).movedim(dim, -1), (1, 0)).movedim(-1, dim)
        at = torch.arange(mask.shape[dim], device=mask.device)
        first, last = (at - radius).clamp(min=0), (at + radius + 1).clamp(max=mask.shape[dim])
        mask = count.index_select(dim, last) > count.index_select(dim, first)
    return mask
