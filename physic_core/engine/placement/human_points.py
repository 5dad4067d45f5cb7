"""Stage 2: the 3D points of each person in the metric scene (paper Sec. 3.2).

The point map of the original photo is aligned to the scene on the background. The alignment is then applied to people.
OpenCV camera frame, metres.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from physic_core.engine.placement.settings import PlacementSettings
from physic_core.engine.scene.cleaning import edge_ratio, outlier_mask
from physic_core.engine.scene.settings import Outliers
from physic_core.geometry.alignment import Alignment, AlignmentOptions, align, apply_alignment, options_as_released
from physic_core.geometry.pointmap import depth_edges, depth_to_pointmap
from physic_core.types import AffineAmbiguity

__all__ = ["ALIGN_LEAST_SHARE", "ALIGN_TOLERANCE", "FAR_M", "align_original", "human_points", "original_in_scene"]

ALIGN_TOLERANCE = 0.15
"""The two point maps agree at a pixel where they differ by less than this share of the depth. A threshold
below 0.1 fits only one surface if the two point maps differ."""

ALIGN_LEAST_SHARE = 0.5
"""Below this share of agreeing background the alignment is reported as unreliable."""

FAR_M = 50.0
"""Background beyond this distance is left out of the alignment, metres."""

MAX_POINTS = 3000
"""Points of one person at most: the time of Eq. 4 is proportional to their number."""

_MASK_GROWTH = 0.01  # of the long image side: networks blur depth at the silhouette
_DEPTH_SHARE = 0.15  # of the range of inverse depths, over which the weight of background falls off
_FAR_WEIGHT = 0.05  # of background far from the people's depth
_MARGIN_PX = 8


def align_original(
    points: Tensor,
    valid: Tensor,
    unknown: AffineAmbiguity,
    scene_points: Tensor,
    scene_valid: Tensor,
    people_mask: Tensor,
    settings: PlacementSettings | None = None,
    far: float = math.inf,
) -> Alignment:
    """Align the point map of the original photo to that of the scene (Eq. 1), on the background of the people.

    Args:
        points: (H, W, 3) point map of the original photo.
        valid: (H, W) bool.
        unknown: its ambiguity relative to the scene: scale, or scale and z-shift.
        scene_points: (H, W, 3) point map of the scene, in metres or in any unit.
        scene_valid: (H, W) bool.
        people_mask: (H, W) bool, all people.
        settings: of stage 2; preset "default" where None. The robust method grows the people's mask, and weights
            background by its nearness to the people's depth.
        far: scene pixels beyond are left out, in the unit of the scene; ``FAR_M`` for a metric scene.

    Returns:
        The alignment; ``inlier_share`` is 0 if the two have no common pixels.
    """
    settings = settings or PlacementSettings()
    radius = round(_MASK_GROWTH * max(people_mask.shape)) if settings.robust else 0
    background = ~_dilate(people_mask, radius) & (scene_points[..., 2] <= far)
    options, weight = options_as_released(ALIGN_TOLERANCE), None
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


def original_in_scene(points: Tensor, alignment: Alignment, K: Tensor | None) -> Tensor:
    """The point map of the original photo in the scene: aligned, and moved onto the rays of ``K`` (3, 3) if given.

    Returns:
        (H, W, 3) metres; all NaN if the alignment has no inliers, since the distance of people is then unknown.
    """
    if alignment.inlier_share == 0:
        return torch.full_like(points, math.nan)
    aligned = apply_alignment(points, alignment)
    return aligned if K is None else depth_to_pointmap(aligned[..., 2], K)


def human_points(points: Tensor, valid: Tensor, mask: Tensor, settings: PlacementSettings | None = None) -> Tensor:
    """The points of one person, without depth edges between person and background.

    Args:
        points: (H, W, 3) metres, of the original photo, aligned to the scene.
        valid: (H, W) bool.
        mask: (H, W) bool, the person's visible pixels.
        settings: of stage 2; preset "default" where None.

    Returns:
        (M, 3) metres; M = 0 if the mask has no valid point. At most ``MAX_POINTS``, evenly subsampled; all of them
        with the paper's methods.
    """
    settings = settings or PlacementSettings()
    outliers: Outliers = "grid" if settings.robust else "knn"
    box = _box(mask)
    if box is None:
        return points.new_zeros((0, 3))
    rows, columns = mask.shape
    ratio = edge_ratio(outliers, rows, columns)
    cloud, inside = points[box], mask[box]
    known = valid[box] & torch.isfinite(cloud).all(-1) & (cloud[..., 2] > 0)
    cloud = torch.where(known[..., None], cloud, 0.0)
    # Edges are computed on a box larger than the mask: at its rim the network mixes person and background.
    own = known & inside & ~depth_edges(cloud[..., 2], known, ratio)
    chosen = cloud[own & ~outlier_mask(cloud, own, outliers, size=(rows, columns))]
    if settings.robust and len(chosen) > MAX_POINTS:
        pick = torch.linspace(0, len(chosen) - 1, MAX_POINTS, dtype=torch.float64, device=chosen.device)
        chosen = chosen[pick.round().long()]
    return chosen


def _nearness_to_people(depth: Tensor, valid: Tensor, people: Tensor, background: Tensor) -> Tensor | None:
    """(H, W) weight of background by its nearness to the people's depth.

    The point maps of two pictures differ by more than one affine map. Sky and far walls are the majority of pixels, so
    without weights the ground at the feet would be wrong. Nearness is a difference of inverse depths over their range.
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
    """Two quantiles of (M,) values, on a subsample if there are many."""
    some = values[:: max(1, len(values) // 20_000)].double().sort().values
    last = len(some) - 1
    return float(some[round(low * last)]), float(some[round(high * last)])


def _box(mask: Tensor) -> tuple[slice, slice] | None:
    """Rows and columns of a mask's bounding box with a margin, or None for an empty mask."""
    if not bool(mask.any()):
        return None
    spans = []
    for dim, size in ((1, mask.shape[0]), (0, mask.shape[1])):
        hit = mask.any(dim).nonzero()
        spans.append(slice(max(0, int(hit[0]) - _MARGIN_PX), min(size, int(hit[-1]) + 1 + _MARGIN_PX)))
    return spans[0], spans[1]


def _dilate(mask: Tensor, radius: int) -> Tensor:
    """(H, W) bool grown by a square of ``radius`` px."""
    if radius < 1:
        return mask
    grown = mask[None, None].float()
    for size, pad in (((2 * radius + 1, 1), (radius, 0)), ((1, 2 * radius + 1), (0, radius))):
        grown = torch.nn.functional.max_pool2d(grown, size, stride=1, padding=pad)
    return grown[0, 0] > 0
