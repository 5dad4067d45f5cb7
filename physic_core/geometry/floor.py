"""The search for the floor in a point map.

A plane n . X + o = 0 is linear in inverse depth: with the ray (x, y, 1) = X / Z of a pixel, 1 / Z = a x + b y + c,
where n = -(a, b, c) / |(a, b, c)| and o = 1 / |(a, b, c)|. Fitting there needs no scale and no metres, and gives what
is far away, and badly known, the small weight it deserves: :func:`fit_floor`. The paper's search is
:func:`physic_core.geometry.floor_metric.fit_floor_metric`.
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
    BlockSamples,
    fit_plane,
    plane_shares,
    sample_blocks,
)
from physic_core.geometry.gravity import gravity

__all__ = ["FIRMNESS", "LEAST_SHARE", "FloorEvidence", "FloorReason", "FloorSearch", "PlaneFit", "fit_floor"]

FloorReason = Literal["found", "no_pixels", "no_consensus", "below_plane", "switched_off"]
"""Why a search ended: "found"; too few pixels to search; too small a share on any level plane; too many valid pixels
clearly below the best plane, which then is a table and not the floor; or the settings switch the floor off."""

TOLERANCE = 0.02
"""Largest error of an inlier, as a share of the range of inverse depth: the error of depth networks on floors."""

LEAST_SHARE = 0.15
"""Least share of pixels that a plane through people's feet needs; the smallest with which a floor is accepted."""

FIRMNESS = 0.11
"""How clearly the surfaces must show which way is up, see :class:`physic_core.geometry.gravity.Gravity`."""

FEET_WINDOW = 0.08
"""How far round the feet the floor is looked at, as a share of the long image side."""

MAX_BELOW = 0.1
"""Largest share of the watched pixels that may lie below a floor: more of them, and it is a table."""

_PICTURE_SHARE = 0.3  # least share of the lower part on a plane: separates usable floors from none
_MASK_SHARE = 0.5  # least share of the mask on a plane
_MASK_SLACK = 2.5  # tolerances of a second try on the mask: networks bend what a segmenter knows to be a floor
_LEAST_RISE = 0.05  # of inverse depth from top to bottom, as a share of its range
_FEET_NEAR = 0.006  # of the long side: feet that vouch for a plane are looked at closely
_FEET_AGREE = 0.1  # relative error of inverse depth at feet that vouch for a plane
_REANCHOR_RANGE = (0.5, 2.0)
_REANCHOR_BANDS = 4.0  # tolerances from the plane beyond which pixels round the feet show something else
_TWO_WITNESSES = 0.9  # of the share that a mask needs alone, where the surfaces agree
_LEVEL_COSINE = math.cos(math.radians(25.0))  # of a level pixel's normal with up
_LEVELS = 3  # level surfaces that are tried before there is no floor
_LEAST_LEVEL = 0.01  # of the picture
_LEVEL_BELOW = 0.04  # as ``MAX_BELOW``, of a surface that neither mask nor size vouches for


@dataclass(frozen=True)
class FloorEvidence:
    """What is known of the floor besides the point map.

    Attributes:
        mask: (H, W) bool, pixels that a segmenter calls floor, or None.
        hole: (H, W) bool, inpainted pixels, or None.
        feet_px: (F, 2) px, floor pixels at people's soles; F may be 0; or None.
    """

    mask: Tensor | None = None
    hole: Tensor | None = None
    feet_px: Tensor | None = None


@dataclass(frozen=True)
class PlaneFit:
    """A floor found in a point map.

    Attributes:
        normal: (3,) unit, up, on the camera's side.
        offset: height of the camera over the plane > 0, in the unit of the points.
        inliers: (H, W) bool, pixels on the plane.
        inlier_share: share of the searched pixels that lie on the plane.
        below_share: share of the searched part of the picture that lies clearly below it.
        source: where it was searched.
        reanchored: factor on 1 / Z that moved the plane to the depth at the feet; 1 where nothing was moved.
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
    """Result of a search.

    Attributes:
        plane: the floor, or None.
        reason: why the search ended so.
        inlier_share: of the best plane, accepted or not.
        below_share: of the best plane, accepted or not.
        mask_reason: why the floor mask was not followed, where one was given and was not; None otherwise.
    """

    plane: PlaneFit | None
    reason: FloorReason
    inlier_share: float = 0.0
    below_share: float = 0.0
    mask_reason: FloorReason | None = None


class _View(NamedTuple):
    """A point map as inverse depth over rays, and what the search knows of it."""

    rays: Tensor  # (H, W, 3), X / Z, zero where not valid
    inverse: Tensor  # (H, W), 1 / Z
    valid: Tensor  # (H, W) bool
    tolerance: float  # inverse depth
    least_rise: float  # inverse depth
    evidence: FloorEvidence
    normals: Tensor | None  # (H, W, 3)
    up: Tensor | None  # (3,), where the surfaces show it clearly

    def samples(self, mask: Tensor | None) -> BlockSamples:
        return sample_blocks(self.rays, self.inverse, self.valid, mask, self.evidence.hole)

    def error(self, plane: Tensor) -> Tensor:
        """(H, W) |inverse depth - that of a plane|."""
        return (self.inverse - self.rays @ plane.to(self.rays)).abs()


def fit_floor(
    points: Tensor, valid: Tensor, evidence: FloorEvidence | None = None, normals: Tensor | None = None
) -> FloorSearch:
    """Find the floor of a point map in inverse depth.

    The search takes the pixels of the floor mask first. If no plane there is accepted, it takes the lower part of the
    picture, and at last its level surfaces, the largest first. The plane must be seen from above (not from straight
    above: that could be a wall) and be level. Where the surfaces show which way is up, it must agree with that. The
    feet draw no hypotheses, since they would make the slope a local one: they vouch for the plane found. Then the
    plane is moved, its horizon kept, to the depth seen round them.

    Args:
        points: (H, W, 3), any unit, preferably of the photo without its people.
        valid: (H, W) bool.
        evidence: floor mask, inpainted pixels and feet, each where known.
        normals: (H, W, 3) unit, of the surfaces, zero where unknown; None leaves up unknown.

    Returns:
        The result; its ``plane`` is None where no floor is accepted.
    """
    view = _view(points, valid, evidence or FloorEvidence(), normals)
    if isinstance(view, str):
        return FloorSearch(None, view)
    mask = view.evidence.mask
    if mask is None or not bool(mask.any()):
        return _search_picture(view)
    masked = _search_mask(view, mask, view.tolerance)
    if masked.reason == "no_consensus":
        masked = _search_mask(view, mask, _MASK_SLACK * view.tolerance)
    return masked if masked.plane is not None else replace(_search_picture(view), mask_reason=masked.reason)


def _view(points: Tensor, valid: Tensor, evidence: FloorEvidence, normals: Tensor | None) -> _View | FloorReason:
    valid = valid & torch.isfinite(points).all(-1) & (points[..., 2] > 0)
    inverse = torch.where(valid, 1 / points[..., 2], 0.0)
    rays = torch.where(valid[..., None], points * inverse[..., None], 0.0)
    known = inverse[valid]
    if len(known) < FEWEST_SAMPLES:
        return "no_pixels"
    spread = _range(known)
    if not TOLERANCE * spread > 0:
        return "no_consensus"
    shown = None if normals is None else gravity(normals[valid])
    up = shown.up if shown is not None and shown.firmness >= FIRMNESS else None
    return _View(rays, inverse, valid, TOLERANCE * spread, _LEAST_RISE * spread, evidence, normals, up)


def _range(values: Tensor) -> float:
    """Between the 1st and the 99th percentile of (M,) values, looking at some of them where there are many."""
    some = values[:: max(1, len(values) // 50_000)].double().sort().values
    last = len(some) - 1
    return float(some[round(0.99 * last)] - some[round(0.01 * last)])


def _search_mask(view: _View, mask: Tensor, tolerance: float) -> FloorSearch:
    samples = view.samples(mask)
    plane = _plane_of(samples, view, tolerance)
    if isinstance(plane, str):
        return FloorSearch(None, plane)
    shares = plane_shares(samples, plane, tolerance)
    rejected = _rejected(shares, _MASK_SHARE if view.up is None else _MASK_SHARE * _TWO_WITNESSES)
    if rejected is not None:
        return rejected
    floor = view.valid & mask & (view.error(plane) < _REANCHOR_BANDS * tolerance)
    return _accepted(view, plane, shares, "floor mask", tolerance, floor)


def _search_picture(view: _View) -> FloorSearch:
    first = _search_lower_part(view)
    return first if first.plane is not None else _search_level_surfaces(view) or first


def _search_lower_part(view: _View) -> FloorSearch:
    samples = view.samples(None)
    plane = _plane_of(samples, view, view.tolerance)
    if isinstance(plane, str):
        return FloorSearch(None, plane)
    shares = plane_shares(samples, plane, view.tolerance)
    factors = _feet_factors(plane, view, view.valid, view.tolerance, _FEET_NEAR)
    vouched = len(factors) > 0 and float((factors - 1).abs().median()) < _FEET_AGREE
    rejected = _rejected(shares, min(_PICTURE_SHARE, LEAST_SHARE) if vouched else _PICTURE_SHARE)
    return rejected or _accepted(view, plane, shares, "lower image", view.tolerance, view.valid)


def _search_level_surfaces(view: _View) -> FloorSearch | None:
    """The largest level surface of the lower part with hardly anything below it: tables have a floor below them."""
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
            plane = _plane_of(samples, view, tolerance)
            if isinstance(plane, str):
                break
            on = plane_shares(samples, plane, tolerance)[0]
            below = plane_shares(samples, plane, view.tolerance)[1]
            near = view.error(plane) < tolerance
            if on > _PICTURE_SHARE and below <= _LEVEL_BELOW:
                return _accepted(view, plane, (on, below), "lower image", tolerance, level & near)
            left = left & ~near
    return None


def _plane_of(samples: BlockSamples, view: _View, tolerance: float) -> Tensor | FloorReason:
    if int(samples.candidate.sum()) < FEWEST_SAMPLES:
        return "no_pixels"
    plane = fit_plane(samples, tolerance, view.least_rise, view.up)
    return "no_consensus" if plane is None else plane


def _rejected(shares: tuple[float, float], least: float) -> FloorSearch | None:
    """The failed search, where too little lies on a plane, or too much below it; None where the plane is accepted."""
    on, below = shares
    if on <= least:
        return FloorSearch(None, "no_consensus", on, below)
    if below > MAX_BELOW:
        return FloorSearch(None, "below_plane", on, below)
    return None


def _accepted(
    view: _View,
    plane: Tensor,
    shares: tuple[float, float],
    source: Literal["floor mask", "lower image"],
    tolerance: float,
    floor: Tensor,
) -> FloorSearch:
    """The search that found ``plane``, moved to the depth of the pixels of ``floor`` (H, W) round the feet."""
    expected = view.rays @ plane.to(view.rays)
    length = float(torch.linalg.vector_norm(plane))
    inliers = view.valid & ((view.inverse - expected).abs() < tolerance) & (expected > 2 * tolerance)
    fit = PlaneFit(-(plane / length).to(view.rays), 1 / length, inliers, *shares, source)
    return FloorSearch(_reanchored(fit, _feet_factors(plane, view, floor, tolerance, FEET_WINDOW)), "found", *shares)


def _feet_factors(plane: Tensor, view: _View, pixels: Tensor, tolerance: float, window: float) -> Tensor:
    """Inverse depth seen over inverse depth of the plane, for each foot that the plane can be compared with.

    Seen are ``pixels`` (H, W) within a ``window`` round the foot, as a share of the long side.
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


def _reanchored(fit: PlaneFit, factors: Tensor) -> PlaneFit:
    """Scale a plane's inverse depth so that it passes through the pixels at the feet; its normal stays."""
    if not len(factors):
        return fit
    factor = float(factors.quantile(0.5))
    if not _REANCHOR_RANGE[0] < factor < _REANCHOR_RANGE[1]:
        return fit
    return replace(fit, offset=fit.offset / factor, reanchored=factor)
