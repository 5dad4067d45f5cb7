"""Stage 2: the people's own points in the metric scene (paper Sec. 3.2), and the way to :func:`place` their bodies.

The point map of the original photo is aligned to the scene outside the people, which carries their points along.
OpenCV camera frame, metres.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from physic_core.engine.placement.place import Placement, place
from physic_core.engine.scene.build import edge_ratio_at, outlier_mask
from physic_core.engine.settings import HumanSettings
from physic_core.geometry.alignment import Alignment, align, apply_alignment
from physic_core.geometry.pointmap import depth_edges, depth_to_pointmap
from physic_core.types import AffineAmbiguity

__all__ = ["Placement", "align_original", "human_points", "place", "placed_original"]

_MARGIN_PX = 8
_FAR_WEIGHT = 0.05


def align_original(
    points: Tensor,
    valid: Tensor,
    unknown: AffineAmbiguity,
    scene_points: Tensor,
    scene_valid: Tensor,
    people_mask: Tensor,
    settings: HumanSettings | None = None,
    *,
    far: float = math.inf,
) -> Alignment:
    """Align the original photo's point map to the scene's, outside the people.

    Args:
        points: (H, W, 3) point map of the original photo.
        valid: (H, W) bool.
        unknown: what it leaves open towards the scene.
        scene_points: (H, W, 3) point map of the scene, in metres or in any unit.
        scene_valid: (H, W) bool.
        people_mask: (H, W) bool, all people; grown by ``settings.mask_dilation``, since a network smears depth there.
        settings: of stage 2; preset "default" where None.
        far: scene pixels beyond are left out, in the unit of the scene; give ``settings.far_m`` for a metric scene.

    Returns:
        The alignment; ``inlier_share`` 0 where the two have nothing in common.
    """
    settings = settings or HumanSettings()
    radius = round(settings.mask_dilation * max(people_mask.shape))
    background = ~_dilate(people_mask, radius) & (scene_points[..., 2] <= far)
    weight = None
    if settings.align_depth_share > 0:
        weight = _at_peoples_depth(points[..., 2], valid, people_mask, background, settings.align_depth_share)
    return align(
        points,
        valid & background,
        scene_points,
        scene_valid & background,
        unknown,
        tolerance=settings.align_tolerance,
        iterations=settings.align_hypotheses,
        residual=settings.align_residual,
        weight=weight,
        max_pixels=settings.align_max_pixels,
        seed=settings.seed,
    )


def placed_original(points: Tensor, alignment: Alignment, K: Tensor | None) -> Tensor:
    """The original photo's point map in the scene: aligned, and put on the pixels' rays where ``K`` (3, 3) is given.

    Returns:
        (H, W, 3) metres; NaN throughout where the alignment found nothing in common, so that nobody gets points whose
        distance is unknown.
    """
    if alignment.inlier_share == 0:
        return torch.full_like(points, math.nan)
    aligned = apply_alignment(points, alignment)
    return aligned if K is None else depth_to_pointmap(aligned[..., 2], K)


def human_points(points: Tensor, valid: Tensor, mask: Tensor, settings: HumanSettings | None = None) -> Tensor:
    """The points of one person, without what floats between them and the background.

    Args:
        points: (H, W, 3) metres, of the original photo, aligned to the scene.
        valid: (H, W) bool.
        mask: (H, W) bool, the person's visible pixels.
        settings: of stage 2; preset "default" where None.

    Returns:
        (M, 3) metres; M = 0 where the mask holds nothing valid. At most ``settings.max_points``, evenly picked.
    """
    settings = settings or HumanSettings()
    box = _box(mask)
    if box is None:
        return points.new_zeros((0, 3))
    ratio = edge_ratio_at(settings.edge_ratio, *mask.shape)
    cloud, inside = points[box], mask[box]
    known = valid[box] & torch.isfinite(cloud).all(-1) & (cloud[..., 2] > 0)
    cloud = torch.where(known[..., None], cloud, 0.0)
    # The edges look past the mask: its rim is where the network mixes person and background.
    own = known & inside & ~depth_edges(cloud[..., 2], known, ratio)
    chosen = cloud[own & ~outlier_mask(cloud, own, settings, size=(mask.shape[0], mask.shape[1]))]
    if settings.max_points and len(chosen) > settings.max_points:
        pick = torch.linspace(0, len(chosen) - 1, settings.max_points, dtype=torch.float64, device=chosen.device)
        chosen = chosen[pick.round().long()]
    return chosen


def _at_peoples_depth(depth: Tensor, valid: Tensor, people: Tensor, background: Tensor, share: float) -> Tensor | None:
    """(H, W) weight of background that is about as near as the people, where the two maps have to agree.

    Two runs of a network on two pictures do not agree everywhere; on whole pictures sky and far walls have the
    majority, and the ground at the feet would be off. Nearness is a difference of inverse depths over their range.
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
    gap = torch.maximum(low - inverse, inverse - high).clamp(min=0) / (share * extent)
    return _FAR_WEIGHT + (1 - _FAR_WEIGHT) * torch.exp(-0.5 * gap.square())


def _quantiles(values: Tensor, low: float, high: float) -> tuple[float, float]:
    """Two quantiles of (M,) values, looking at some of them where there are many."""
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
