"""Floor search in a point map.

A plane n . X + o = 0 is linear in inverse depth: with the ray (x, y, 1) = X / Z of a pixel, 1 / Z = a x + b y + c,
where ``n = -(a, b, c) / |(a, b, c)|`` and ``o = 1 / |(a, b, c)|``. :func:`fit_floor` fits in inverse depth: this needs
no scale, and uncertain distant points have little weight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import torch
from torch import Tensor

from physic_core.geometry.floor_ransac import (
    FEWEST_SAMPLES,
    LOWER_SHARE,
    BlockMeans,
    average_blocks,
    fit_plane,
    plane_inlier_shares,
)
from physic_core.geometry.gravity import estimate_up
from physic_core.geometry.tensors import all_finite, select_pixels

FloorReason = Literal["found", "no_pixels", "no_consensus", "below_plane", "switched_off"]
"""Reason why a search ended: "found"; "no_pixels": too few pixels; "no_consensus": too few inliers; "below_plane": too
many pixels below the best plane, so that it is not floor; "switched_off" by the settings."""

_TOLERANCE = 0.02
"""Largest error of an inlier, as a share of the range of inverse depth."""

MIN_INLIER_SHARE = 0.15
"""Least inlier share of any accepted floor: that of a plane through people's feet."""

MIN_UP_CONFIDENCE = 0.11
"""Least confidence of an up direction that is used, see :class:`physic_core.geometry.gravity.UpEstimate`."""

FEET_WINDOW = 0.08
"""Half side of the pixel window around each foot, as a share of the long image side."""

MAX_BELOW_SHARE = 0.1
"""Largest share of the lower part's pixels below a floor; a plane with more is a table or seat."""

_PICTURE_SHARE = 0.3  # least inlier share in the lower part of the image
_MASK_SHARE = 0.5  # least inlier share in the floor mask
_MASK_BELOW_SHARE = 0.15  # as ``MAX_BELOW_SHARE``, for a floor mask: networks bend floors, and a table is not a floor
_MASK_SLACK = 2.5  # factor on the tolerance of a second fit to the mask, as depth networks bend floors
_LEAST_RISE = 0.05  # least increase of inverse depth from top to bottom, as a share of its range
_FEET_NEAR = 0.006  # as ``FEET_WINDOW``, to confirm a plane
_FEET_AGREE = 0.1  # largest relative error of inverse depth at feet that confirm a plane
_REANCHOR_RANGE = (0.5, 2.0)
_REANCHOR_BANDS = 4.0  # largest distance of floor pixels near feet from the plane, in tolerances
_STEEP_COSINE = math.cos(math.radians(35.0))  # between up and the camera's up axis, of a camera that looks down steeply
_MASK_SHARE_FACTOR = 0.9  # on ``_MASK_SHARE``, if the up direction is known
_LEVEL_COSINE = math.cos(math.radians(25.0))  # least cosine between up and the normal of a horizontal pixel
_LEVELS = 3  # number of horizontal surfaces tried
_LEAST_LEVEL = 0.01  # least share of a horizontal surface in the image
_LEVEL_BELOW = 0.04  # as ``MAX_BELOW_SHARE``, for a horizontal surface


@dataclass(frozen=True)
class FloorEvidence:
    """Floor mask, inpainted pixels and pixels at soles, as input of the floor fit.

    Attributes:
        mask: (H, W) bool, pixels that a segmenter labels floor, or None.
        hole: (H, W) bool, inpainted pixels, or None.
        feet_px: (F, 2) px, floor pixels at people's soles; F may be 0; or None.
    """

    mask: Tensor | None = None
    hole: Tensor | None = None
    feet_px: Tensor | None = None


@dataclass(frozen=True)
class PlaneFit:
    """A floor plane fitted to a point map.

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
    source: Literal["floor mask", "lower image"]
    reanchored: float = 1.0


@dataclass(frozen=True)
class FloorSearch:
    """Result of a floor search.

    Attributes:
        plane: the floor, or None.
        reason: why the search ended.
        inlier_share: of the best plane, accepted or not.
        below_share: of the best plane, accepted or not.
        mask_reason: why the given floor mask was rejected, or None.
    """

    plane: PlaneFit | None
    reason: FloorReason
    inlier_share: float = 0.0
    below_share: float = 0.0
    mask_reason: FloorReason | None = None


class _InverseDepthMap(NamedTuple):
    """A point map as inverse depth over rays, with the evidence of the search."""

    rays: Tensor  # (H, W, 3), X / Z, zero where not valid
    inverse: Tensor  # (H, W), 1 / Z
    valid: Tensor  # (H, W) bool
    tolerance: float  # inverse depth
    least_rise: float  # inverse depth
    evidence: FloorEvidence
    normals: Tensor | None  # (H, W, 3)
    up: Tensor | None  # (3,), None if not confident

    def samples(self, mask: Tensor | None) -> BlockMeans:
        return average_blocks(self.rays, self.inverse, self.valid, mask, self.evidence.hole)

    def error(self, plane: Tensor) -> Tensor:
        """Return the absolute error (H, W) of a plane in inverse depth."""
        return (self.inverse - self.rays @ plane.to(self.rays)).abs()


def fit_floor(
    points: Tensor, valid: Tensor, evidence: FloorEvidence | None = None, normals: Tensor | None = None
) -> FloorSearch:
    """Fit a floor plane to a point map in inverse depth.

    The candidates are the pixels of the floor mask, then the lower part of the image, then its horizontal surfaces, the
    largest first. The plane must be seen from above, must not be rolled, and must agree with a known up direction. Feet
    confirm a plane but draw no hypotheses. Finally the plane is moved to the depth around the feet; its normal stays.

    Args:
        points: (H, W, 3), any unit, preferably of the photo without its people.
        valid: (H, W) bool.
        evidence: of the floor, or None.
        normals: (H, W, 3) unit, zero where unknown; None leaves up unknown.

    Returns:
        The result; its ``plane`` is None if no floor is accepted.
    """
    view = _inverse_depth_map(points, valid, evidence or FloorEvidence(), normals)
    if isinstance(view, str):
        return FloorSearch(None, view)
    found = _search(view)
    if found.plane is None and view.normals is not None:
        # The estimated up direction may belong to a wall, if the camera looks down steeply.
        up = _steep_up(view)
        again = found if up is None else _search(view._replace(up=up))
        found = again if again.plane is not None else found
    return found


def _search(view: _InverseDepthMap) -> FloorSearch:
    mask = view.evidence.mask
    if mask is None or not bool(mask.any()):
        return _search_picture(view)
    masked = _search_mask(view, mask, view.tolerance)
    if masked.reason == "no_consensus":
        masked = _search_mask(view, mask, _MASK_SLACK * view.tolerance)
    return masked if masked.plane is not None else replace(_search_picture(view), mask_reason=masked.reason)


def _steep_up(view: _InverseDepthMap) -> Tensor | None:
    """Estimate up (3,) from the best plane of the floor mask, else of the lower part, if it is steep in the camera."""
    mask = view.evidence.mask
    samples = view.samples(mask if mask is not None and bool(mask.any()) else None)
    plane = _fit_plane(samples, view._replace(up=None), _MASK_SLACK * view.tolerance)
    if isinstance(plane, str) or view.normals is None:
        return None
    normal = -plane / torch.linalg.vector_norm(plane)
    if float(-normal[1]) > _STEEP_COSINE:
        return None
    estimate = estimate_up(select_pixels(view.valid, view.normals)[0], normal)
    return estimate.up if estimate is not None and estimate.confidence >= MIN_UP_CONFIDENCE else None


def _inverse_depth_map(
    points: Tensor, valid: Tensor, evidence: FloorEvidence, normals: Tensor | None
) -> _InverseDepthMap | FloorReason:
    valid = valid & all_finite(points) & (points[..., 2] > 0)
    inverse = torch.where(valid, 1 / points[..., 2], 0.0)
    rays = torch.where(valid[..., None], points * inverse[..., None], 0.0)
    (known,) = select_pixels(valid, inverse)
    if len(known) < FEWEST_SAMPLES:
        return "no_pixels"
    spread = _percentile_range(known)
    if not _TOLERANCE * spread > 0:
        return "no_consensus"
    shown = None if normals is None else estimate_up(select_pixels(valid, normals)[0])
    up = shown.up if shown is not None and shown.confidence >= MIN_UP_CONFIDENCE else None
    return _InverseDepthMap(rays, inverse, valid, _TOLERANCE * spread, _LEAST_RISE * spread, evidence, normals, up)


def _percentile_range(values: Tensor) -> float:
    """Return the range from the 1st to the 99th percentile of values (M,), of a subsample if there are many."""
    some = values[:: max(1, len(values) // 50_000)].double().sort().values
    last = len(some) - 1
    return float(some[round(0.99 * last)] - some[round(0.01 * last)])


def _search_mask(view: _InverseDepthMap, mask: Tensor, tolerance: float) -> FloorSearch:
    samples = view.samples(mask)
    plane = _fit_plane(samples, view, tolerance)
    if isinstance(plane, str):
        return FloorSearch(None, plane)
    shares = plane_inlier_shares(samples, plane, tolerance)
    least = _MASK_SHARE if view.up is None else _MASK_SHARE * _MASK_SHARE_FACTOR
    rejected = _rejection(shares, least, _MASK_BELOW_SHARE)
    if rejected is not None:
        return rejected
    floor = view.valid & mask & (view.error(plane) < _REANCHOR_BANDS * tolerance)
    return _floor_result(view, plane, shares, "floor mask", tolerance, floor)


def _search_picture(view: _InverseDepthMap) -> FloorSearch:
    first = _search_lower_part(view)
    return first if first.plane is not None else _search_level_surfaces(view) or first


def _search_lower_part(view: _InverseDepthMap) -> FloorSearch:
    samples = view.samples(None)
    plane = _fit_plane(samples, view, view.tolerance)
    if isinstance(plane, str):
        return FloorSearch(None, plane)
    shares = plane_inlier_shares(samples, plane, view.tolerance)
    factors = _depth_factors_at_feet(plane, view, view.valid, view.tolerance, _FEET_NEAR)
    feet_agree = len(factors) > 0 and float((factors - 1).abs().median()) < _FEET_AGREE
    least = min(_PICTURE_SHARE, MIN_INLIER_SHARE) if feet_agree else _PICTURE_SHARE
    rejected = _rejection(shares, least, MAX_BELOW_SHARE)
    return rejected or _floor_result(view, plane, shares, "lower image", view.tolerance, view.valid)


def _search_level_surfaces(view: _InverseDepthMap) -> FloorSearch | None:
    """Fit the largest horizontal surface of the lower part with few pixels below it."""
    if view.up is None or view.normals is None:
        return None
    rows = len(view.valid)
    lower = torch.arange(rows, device=view.valid.device)[:, None] >= (1 - LOWER_SHARE) * rows
    level = view.valid & lower & (view.normals.double() @ view.up > _LEVEL_COSINE)
    for tolerance in (view.tolerance, _MASK_SLACK * view.tolerance):
        left = level
        for _ in range(_LEVELS):
            if float(left.double().mean()) < _LEAST_LEVEL:
                break
            samples = view.samples(left)
            plane = _fit_plane(samples, view, tolerance)
            if isinstance(plane, str):
                break
            on = plane_inlier_shares(samples, plane, tolerance)[0]
            below = plane_inlier_shares(samples, plane, view.tolerance)[1]
            near = view.error(plane) < tolerance
            if on > _PICTURE_SHARE and below <= _LEVEL_BELOW:
                return _floor_result(view, plane, (on, below), "lower image", tolerance, level & near)
            left = left & ~near
    return None


def _fit_plane(samples: BlockMeans, view: _InverseDepthMap, tolerance: float) -> Tensor | FloorReason:
    if int(samples.candidate.sum()) < FEWEST_SAMPLES:
        return "no_pixels"
    plane = fit_plane(samples, tolerance, view.least_rise, view.up)
    return "no_consensus" if plane is None else plane


def _rejection(shares: tuple[float, float], least: float, below_most: float) -> FloorSearch | None:
    """Return a failed search if too few pixels lie on the plane or too many below it, else None."""
    on, below = shares
    if on <= least:
        return FloorSearch(None, "no_consensus", on, below)
    if below > below_most:
        return FloorSearch(None, "below_plane", on, below)
    return None


def _floor_result(
    view: _InverseDepthMap,
    plane: Tensor,
    shares: tuple[float, float],
    source: Literal["floor mask", "lower image"],
    tolerance: float,
    floor: Tensor,
) -> FloorSearch:
    """Return the accepted plane, moved to the depth of the pixels ``floor`` (H, W) around the feet."""
    expected = view.rays @ plane.to(view.rays)
    length = float(torch.linalg.vector_norm(plane))
    inliers = view.valid & ((view.inverse - expected).abs() < tolerance) & (expected > 2 * tolerance)
    fit = PlaneFit(-(plane / length).to(view.rays), 1 / length, inliers, *shares, source)
    return FloorSearch(
        _move_to_feet(fit, _depth_factors_at_feet(plane, view, floor, tolerance, FEET_WINDOW)), "found", *shares
    )


def _depth_factors_at_feet(
    plane: Tensor, view: _InverseDepthMap, pixels: Tensor, tolerance: float, window: float
) -> Tensor:
    """Return the ratio of measured inverse depth to the plane's at each foot in front of the plane's horizon.

    The measurement is the median over ``pixels`` (H, W) in a ``window`` around the foot, a share of the long side.
    """
    feet_px = view.evidence.feet_px
    reach = max(2, round(window * max(pixels.shape)))
    factors = []
    for u, v in [] if feet_px is None else feet_px.round().long().tolist():
        box = (slice(max(0, v - reach), max(0, v + reach + 1)), slice(max(0, u - reach), max(0, u + reach + 1)))
        seen = pixels[box]
        expected = view.rays[box][seen] @ plane.to(view.rays)
        near = expected > 2 * tolerance
        if bool(near.any()):
            factors.append(float((view.inverse[box][seen][near] / expected[near]).median()))
    return torch.tensor(factors, dtype=torch.float64)


def _move_to_feet(fit: PlaneFit, factors: Tensor) -> PlaneFit:
    """Scale the plane's inverse depth by the median factor at the feet; the normal stays."""
    if not len(factors):
        return fit
    factor = float(factors.quantile(0.5))
    if not _REANCHOR_RANGE[0] < factor < _REANCHOR_RANGE[1]:
        return fit
    return replace(fit, offset=fit.offset / factor, reanchored=factor)
