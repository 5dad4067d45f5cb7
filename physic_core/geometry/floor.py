"""Planes of a point map in inverse depth, any of which may be the floor. OpenCV camera frame.

A plane n . X + o = 0 is linear in inverse depth: with the ray (x, y, 1) = X / Z of a pixel, 1 / Z = a x + b y + c,
where ``n = -(a, b, c) / |(a, b, c)|`` and ``o = 1 / |(a, b, c)|``. A fit in inverse depth needs no scale, and uncertain
distant points have little weight.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import torch
from torch import Tensor

from physic_core.geometry.floor_ransac import FEWEST_SAMPLES, average_blocks, fit_plane, plane_inlier_shares, refit
from physic_core.geometry.tensors import all_finite, select_pixels

FloorReason = Literal["found", "no_pixels", "no_consensus", "switched_off"]
"""Result of a search: "found"; "no_pixels": too few pixels; "no_consensus": no plane is more likely than none;
"switched_off" by the settings."""

FloorSource = Literal["floor mask", "labels", "lower image", "level surfaces", "soles"]
"""Pixels that a plane was fitted to: of the floor mask, with the label of a floor, of the lower part of the image, of
its horizontal surfaces, or at the soles of people."""

FEET_WINDOW = 0.08
"""Half side of the pixel window around each foot, as a share of the long image side."""

MASK_SLACK = 1.5
"""Factor on the tolerance of pixels that are said to be floor: depth networks bend floors."""

_TOLERANCE = 0.02  # largest error of an inlier, as a share of the range of inverse depth
_LEAST_RISE = 0.05  # least increase of inverse depth from top to bottom, as a share of its range
_REANCHOR_RANGE = (0.5, 2.0)
_REANCHOR_BANDS = 4.0  # largest distance of floor pixels near feet from the plane, in tolerances


@dataclass(frozen=True)
class PlaneFit:
    """A plane fitted to a point map.

    Attributes:
        normal: (3,) unit, up, on the camera's side.
        offset: height of the camera over the plane > 0, in the unit of the points.
        inliers: (H, W) bool, pixels on the plane.
        inlier_share: share of the candidate pixels on the plane.
        below_share: share of the lower part's pixels below the plane.
        source: image region of the candidates.
        reanchored: factor on 1 / Z that moved the plane to the depth at the feet; 1 if not moved.
    """

    normal: Tensor
    offset: float
    inliers: Tensor
    inlier_share: float
    below_share: float
    source: FloorSource
    reanchored: float = 1.0


@dataclass(frozen=True)
class FloorSearch:
    """Result of a floor search.

    Attributes:
        plane: the floor, or None.
        reason: why the search ended.
        inlier_share: of the best plane, accepted or not.
        below_share: of the best plane, accepted or not.
        in_mask: whether the floor is where the segmenter sees one; None without a floor, or if it sees none.
    """

    plane: PlaneFit | None
    reason: FloorReason
    inlier_share: float = 0.0
    below_share: float = 0.0
    in_mask: bool | None = None


class InverseDepthMap(NamedTuple):
    """A point map as inverse depth over rays."""

    rays: Tensor  # (H, W, 3), X / Z, zero where not valid
    inverse: Tensor  # (H, W), 1 / Z
    valid: Tensor  # (H, W) bool
    tolerance: float  # inverse depth
    least_rise: float  # inverse depth
    hole: Tensor | None  # (H, W) bool, inpainted pixels

    def error(self, plane: Tensor) -> Tensor:
        """Return the error (H, W) of a plane (3,) in inverse depth, positive for pixels in front of it."""
        return self.inverse - self.rays @ plane.to(self.rays)


def inverse_depth_map(points: Tensor, valid: Tensor, hole: Tensor | None = None) -> InverseDepthMap | None:
    """Convert a point map (H, W, 3), valid (H, W), of any unit; None with too few pixels or a single depth."""
    valid = valid & all_finite(points) & (points[..., 2] > 0)
    inverse = torch.where(valid, 1 / points[..., 2], 0.0)
    rays = torch.where(valid[..., None], points * inverse[..., None], 0.0)
    (known,) = select_pixels(valid, inverse)
    spread = _percentile_range(known) if len(known) >= FEWEST_SAMPLES else 0.0
    if not _TOLERANCE * spread > 0:
        return None
    return InverseDepthMap(rays, inverse, valid, _TOLERANCE * spread, _LEAST_RISE * spread, hole)


def _percentile_range(values: Tensor) -> float:
    """Return the range from the 1st to the 99th percentile of values (M,), of a subsample if there are many."""
    some = values[:: max(1, len(values) // 50_000)].double().sort().values
    last = len(some) - 1
    return float(some[round(0.99 * last)] - some[round(0.01 * last)])


def plane_of_pixels(
    view: InverseDepthMap, mask: Tensor | None, up: Tensor | None, source: FloorSource, slack: float = 1.0
) -> tuple[Tensor, PlaneFit] | None:
    """Fit a plane to the pixels of a mask (H, W), or to the lower part of the image without one; None if none fits.

    Args:
        view: the point map.
        mask: candidate pixels.
        up: (3,) unit; the plane is at most 15 degrees off. None allows any plane seen from above by an upright camera.
        source: name of the pixels.
        slack: factor on the tolerance.

    Returns:
        (3,) inverse depth of the plane by ray, and the plane.
    """
    samples = average_blocks(view.rays, view.inverse, view.valid, mask, view.hole)
    if int(samples.candidate.sum()) < FEWEST_SAMPLES:
        return None
    plane = fit_plane(samples, slack * view.tolerance, view.least_rise, up)
    if plane is None:
        return None
    return plane, _as_fit(view, plane, plane_inlier_shares(samples, plane, slack * view.tolerance), source, slack)


def _as_fit(
    view: InverseDepthMap, plane: Tensor, shares: tuple[float, float], source: FloorSource, slack: float = 1.0
) -> PlaneFit:
    """Return a plane (3,) in inverse depth as normal and offset, with its pixels."""
    tolerance, expected = slack * view.tolerance, view.rays @ plane.to(view.rays)
    length = float(torch.linalg.vector_norm(plane))
    inliers = view.valid & ((view.inverse - expected).abs() < tolerance) & (expected > 2 * tolerance)
    return PlaneFit(-(plane / length).to(view.rays), 1 / length, inliers, *shares, source)


def plane_at_feet(view: InverseDepthMap, up: Tensor, feet_px: Tensor) -> tuple[Tensor, PlaneFit] | None:
    """Return the plane with a normal (3,) through the points at the feet (F, 2) px; None if none is in front of them.

    Its inverse depth is that of the median foot.
    """
    feet = feet_px.round().long()
    x, y = (feet[:, i].clamp(0, view.valid.shape[1 - i] - 1) for i in (0, 1))
    rays, inverse = view.rays[y, x].double(), view.inverse[y, x].double()
    slope = -(rays @ up.to(rays))
    seen = view.valid[y, x] & (slope > 1e-3)
    if not bool(seen.any()):
        return None
    plane = -up.double() * (inverse[seen] / slope[seen]).quantile(0.5)
    samples = average_blocks(view.rays, view.inverse, view.valid, None, view.hole)
    shares = plane_inlier_shares(samples, plane, view.tolerance)
    return plane, _as_fit(view, plane, shares, "soles")


def refit_floor(points: Tensor, valid: Tensor, found: FloorSearch) -> FloorSearch:
    """Fit the plane of an earlier search again, in a point map (H, W, 3), valid (H, W), of another unit or camera."""
    view = None if found.plane is None else inverse_depth_map(points, valid)
    if view is None or found.plane is None:
        return found
    on = found.plane.inliers & view.valid
    if int(on.sum()) < FEWEST_SAMPLES:
        return FloorSearch(None, "no_pixels", found.inlier_share, found.below_share)
    plane = refit(view.rays[on].double(), view.inverse[on].double(), MASK_SLACK * view.tolerance)
    shares = found.plane.inlier_share, found.plane.below_share
    fit = _as_fit(view, plane, shares, found.plane.source, MASK_SLACK)
    factor = found.plane.reanchored
    return replace(found, plane=replace(fit, offset=fit.offset / factor, reanchored=factor))


def move_to_feet(
    view: InverseDepthMap, plane: Tensor, fit: PlaneFit, mask: Tensor | None, feet_px: Tensor | None
) -> PlaneFit:
    """Scale the plane's inverse depth by the median factor at the feet; the normal stays.

    Args:
        view: the point map.
        plane: (3,) inverse depth by ray.
        fit: the same plane.
        mask: (H, W) bool, pixels that it was fitted to, which are the ground near it; None for all pixels.
        feet_px: (F, 2) px, or None.
    """
    ground = view.valid
    if mask is not None:
        ground = ground & mask & (view.error(plane).abs() < _REANCHOR_BANDS * view.tolerance)
    factors = _depth_factors_at_feet(plane, view, ground, feet_px)
    factor = float(factors.quantile(0.5)) if len(factors) else 0.0
    if not _REANCHOR_RANGE[0] < factor < _REANCHOR_RANGE[1]:
        return fit
    return replace(fit, offset=fit.offset / factor, reanchored=factor)


def _depth_factors_at_feet(plane: Tensor, view: InverseDepthMap, pixels: Tensor, feet_px: Tensor | None) -> Tensor:
    """Return the ratio of measured inverse depth to the plane's at each foot in front of the plane's horizon.

    The measurement is the median over ``pixels`` (H, W) in a window around the foot.
    """
    reach = max(2, round(FEET_WINDOW * max(pixels.shape)))
    factors = []
    for u, v in [] if feet_px is None else feet_px.round().long().tolist():
        box = (slice(max(0, v - reach), max(0, v + reach + 1)), slice(max(0, u - reach), max(0, u + reach + 1)))
        seen = pixels[box]
        expected = view.rays[box][seen] @ plane.to(view.rays)
        near = expected > 2 * view.tolerance
        if bool(near.any()):
            factors.append(float((view.inverse[box][seen][near] / expected[near]).median()))
    return torch.tensor(factors, dtype=torch.float64)
