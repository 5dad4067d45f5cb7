"""The search for the floor in a point map.

A plane n . X + o = 0 is linear in inverse depth: with the ray (x, y, 1) = X / Z of a pixel, 1 / Z = a x + b y + c,
where n = -(a, b, c) / |(a, b, c)| and o = 1 / |(a, b, c)|. Fitting there needs no scale and no metres, and gives what
is far away, and badly known, the small weight it deserves: :func:`fit_floor`. The paper's way is
:func:`physic_core.geometry.floor_metric.fit_floor_metric`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import torch
from torch import Tensor

from physic_core.geometry.gravity import gravity

__all__ = ["FloorReason", "FloorSearch", "PlaneFit", "fit_floor"]

FloorReason = Literal["found", "no_pixels", "no_consensus", "below_plane", "switched_off"]
"""Why a search ended: "found"; too few pixels to look at; too small a share on any level plane; too many valid pixels
clearly below the best plane, which then is a table and not the floor; or nobody asked."""

_SAMPLES = 16_000
_FEWEST_SAMPLES = 40
_SCORED_SAMPLES = 2000
_FINALISTS = 32
_REFITS = 8
_LEAST_RISE = 0.05
_FEET_WINDOW = 0.006
_FEET_AGREE = 0.1
_REANCHOR_RANGE = (0.5, 2.0)
_REANCHOR_BANDS = 4.0  # farther than this from the plane, pixels round the feet show something else
_UP_COSINE = math.cos(math.radians(15.0))  # of a floor with the up that the surfaces tell
_UP_SIGMA = math.radians(3.0)  # how far off that up may be expected to be
_UP_SHARE = 0.05  # what it weighs, as a share of the floor's own pixels: their errors are those of a few bends
_TWO_WITNESSES = 0.9  # of the pixels that a mask needs alone, where the surfaces agree
_LEVEL_COSINE = math.cos(math.radians(25.0))  # of a level pixel's normal with up
_LEVELS = 3  # level surfaces that are looked at before there is no floor
_LEAST_LEVEL = 0.01  # of the picture
_LEVEL_BELOW = 0.04  # as ``max_below``, of a surface that neither mask nor size vouches for


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
    """What came of a search.

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


class _Samples(NamedTuple):
    """Blocks of pixels: ray coordinates (M, 3) with a one at the end, inverse depth (M,), and what each block is."""

    rays: Tensor
    inverse: Tensor
    weight: Tensor
    candidate: Tensor
    watched: Tensor


def fit_floor(
    points: Tensor,
    valid: Tensor,
    *,
    floor_mask: Tensor | None = None,
    hole: Tensor | None = None,
    feet_px: Tensor | None = None,
    tolerance: float = 0.012,
    mask_slack: float = 2.5,
    hypotheses: int = 1000,
    min_share: float = 0.3,
    mask_min_share: float = 0.5,
    feet_min_share: float = 0.15,
    reanchor: bool = True,
    max_below: float = 0.1,
    max_roll_deg: float = 25.0,
    hole_weight: float = 0.3,
    lower_share: float = 0.6,
    normals: Tensor | None = None,
    firmness: float = 0.11,
    feet_window: float = 0.08,
    seed: int = 0,
) -> FloorSearch:
    """Find the floor of a point map in inverse depth.

    First among the pixels of ``floor_mask``, where given; if nothing there passes the checks, among the lower part of
    the picture, and at last among its level surfaces, of which tables and beds have others below them. The plane must
    be seen from above (not from straight above: that could be a wall) and be level within ``max_roll_deg``; where
    surfaces tell which way is up it must agree, and leans on that where it is small. The feet do not draw
    hypotheses (they would make the slope a local one): they vouch for the plane found, and then move it, its horizon
    kept, to the floor round them.

    Args:
        points: (H, W, 3), any unit, preferably of the photo without its people.
        valid: (H, W) bool.
        floor_mask: (H, W) bool, pixels that a segmenter calls floor, or None.
        hole: (H, W) bool, pixels that an inpainter made up, or None.
        feet_px: (F, 2) px, floor pixels at people's soles; may be empty or None.
        tolerance: of an inlier, as a share of the range of the inverse depth.
        mask_slack: where the mask's pixels agree on no plane, they are tried again with this many tolerances: a
            network may bend what a segmenter knows to be a floor.
        hypotheses: planes drawn.
        min_share: share of the lower part's pixels that must lie on the plane.
        mask_min_share: share of the mask's pixels that must lie on the plane.
        feet_min_share: as ``min_share``, for a plane that passes through the feet by itself.
        reanchor: move the plane found to the feet.
        max_below: largest share of the lower part's pixels that may lie two tolerances or more below it.
        max_roll_deg: largest sideways tilt.
        hole_weight: weight of the pixels of ``hole``.
        lower_share: the lower part of the picture.
        normals: (H, W, 3) unit, of the surfaces, zero where unknown, or None: they tell which way is up.
        firmness: how clearly they must, see :class:`physic_core.geometry.gravity.Gravity`.
        feet_window: how far round the feet the floor is looked at, as a share of the longer side.
        seed: of the draws.

    Returns:
        The search's end; its ``plane`` is None where no floor passes.
    """
    valid = valid & torch.isfinite(points).all(-1) & (points[..., 2] > 0)
    inverse = torch.where(valid, 1 / points[..., 2], 0.0)
    rays = torch.where(valid[..., None], points * inverse[..., None], 0.0)
    known = inverse[valid]
    if len(known) < _FEWEST_SAMPLES:
        return FloorSearch(None, "no_pixels")
    spread = _range(known)
    band = tolerance * spread
    if not band > 0:
        return FloorSearch(None, "no_consensus")

    told = None if normals is None else gravity(normals[valid])
    up = told.up if told is not None and told.firmness >= firmness else None

    def fitted(samples: _Samples, band: float) -> Tensor | FloorReason:
        generator = torch.Generator().manual_seed(seed)
        return _fit_samples(samples, band, _LEAST_RISE * spread, hypotheses, max_roll_deg, generator, up)

    def accepted(
        plane: Tensor, on: float, below: float, source: Literal["floor mask", "lower image"], band: float, floor: Tensor
    ) -> FloorSearch:
        expected = rays @ plane.to(rays)
        length = float(torch.linalg.vector_norm(plane))
        inliers = valid & ((inverse - expected).abs() < band) & (expected > 2 * band)
        fit = PlaneFit(-(plane / length).to(points), 1 / length, inliers, on, below, source)
        if reanchor:
            fit = _reanchored(fit, _feet_factors(plane, rays, inverse, floor, feet_px, band, feet_window))
        return FloorSearch(fit, "found", on, below)

    def search(mask: Tensor | None, share: float, band: float = band) -> FloorSearch:
        samples = _sample(rays, inverse, valid, mask, hole, hole_weight, lower_share)
        plane = fitted(samples, band)
        if isinstance(plane, str):
            return FloorSearch(None, plane)
        on, below = _shares(samples, plane, band)
        if mask is None:
            factors = _feet_factors(plane, rays, inverse, valid, feet_px, band, _FEET_WINDOW)
            if len(factors) and float((factors - 1).abs().median()) < _FEET_AGREE:
                share = min(share, feet_min_share)
        elif up is not None:
            share *= _TWO_WITNESSES
        if on <= share:
            return FloorSearch(None, "no_consensus", on, below)
        if below > max_below:
            return FloorSearch(None, "below_plane", on, below)
        if mask is None:
            return accepted(plane, on, below, "lower image", band, valid)
        floor = valid & mask & ((inverse - rays @ plane.to(rays)).abs() < _REANCHOR_BANDS * band)
        return accepted(plane, on, below, "floor mask", band, floor)

    def search_levels() -> FloorSearch | None:
        """The largest level surface with hardly anything below it, among those of the lower part."""
        if up is None or normals is None:
            return None
        down = torch.arange(len(valid), device=valid.device)[:, None] >= (1 - lower_share) * len(valid)
        level = valid & down & (normals.double() @ up > _LEVEL_COSINE)
        for wide in (band, mask_slack * band):
            left = level
            for _ in range(_LEVELS):
                if float(left.double().mean()) < _LEAST_LEVEL:
                    break
                samples = _sample(rays, inverse, valid, left, hole, hole_weight, lower_share)
                plane = fitted(samples, wide)
                if isinstance(plane, str):
                    break
                on, below = _shares(samples, plane, wide)[0], _shares(samples, plane, band)[1]
                near = (inverse - rays @ plane.to(rays)).abs() < wide
                if on > min_share and below <= _LEVEL_BELOW:
                    return accepted(plane, on, below, "lower image", wide, level & near)
                left = left & ~near
        return None

    def search_picture() -> FloorSearch:
        first = search(None, min_share)
        return first if first.plane is not None else search_levels() or first

    if floor_mask is None or not bool(floor_mask.any()):
        return search_picture()
    masked = search(floor_mask, mask_min_share)
    if masked.reason == "no_consensus" and mask_slack > 1:
        masked = search(floor_mask, mask_min_share, mask_slack * band)
    return masked if masked.plane is not None else replace(search_picture(), mask_reason=masked.reason)


def _range(values: Tensor) -> float:
    """Between the 1st and the 99th percentile of (M,) values, looking at some of them where there are many."""
    some = values[:: max(1, len(values) // 50_000)].double().sort().values
    last = len(some) - 1
    return float(some[round(0.99 * last)] - some[round(0.01 * last)])


def _sample(
    rays: Tensor,
    inverse: Tensor,
    valid: Tensor,
    mask: Tensor | None,
    hole: Tensor | None,
    hole_weight: float,
    lower_share: float,
) -> _Samples:
    """Means over square blocks of pixels: exact on a plane, and calmer than single pixels."""
    rows, columns = valid.shape
    block = max(1, math.ceil(math.sqrt(rows * columns / _SAMPLES)))
    while True:
        share = _block_mean(valid.to(inverse), block)
        candidate = share > 0
        if mask is not None:
            candidate &= _block_mean((mask & valid).to(inverse), block) > 0.5 * share
        if mask is None or block == 1 or int(candidate.sum()) >= 10 * _FEWEST_SAMPLES:
            break
        block = block // 2
    scale = share.clamp(min=torch.finfo(share.dtype).tiny).reciprocal()
    mean_inverse = _block_mean(inverse, block) * scale
    mean_rays = torch.stack([_block_mean(rays[..., i], block) * scale for i in range(3)], -1)
    down = torch.linspace(0, 1, len(share), dtype=share.dtype, device=share.device)[:, None].expand(share.shape)
    lower = down >= 1 - lower_share
    weight = torch.ones_like(share)
    if hole is not None:
        weight = 1 - (1 - hole_weight) * _block_mean(hole.to(inverse), block)
    known = share > 0
    return _Samples(
        rays=mean_rays[known].double(),
        inverse=mean_inverse[known].double(),
        weight=weight[known].double(),
        candidate=(candidate if mask is not None else lower & candidate)[known],
        watched=lower[known],
    )


def _block_mean(x: Tensor, block: int) -> Tensor:
    """(H, W) -> mean over block x block pixels; the last block of a row or column may be smaller."""
    if block == 1:
        return x
    blocks: Tensor = torch.nn.functional.avg_pool2d(x[None, None], block, ceil_mode=True)[0, 0]
    return blocks


def _fit_samples(
    samples: _Samples,
    band: float,
    least_rise: float,
    hypotheses: int,
    max_roll_deg: float,
    generator: torch.Generator,
    up: Tensor | None,
) -> Tensor | FloorReason:
    """RANSAC, then least squares on the consensus: (3,) plane a, b, c, which points against up."""
    index = samples.candidate.nonzero()[:, 0]
    if len(index) < _FEWEST_SAMPLES:
        return "no_pixels"
    slope = least_rise / float(samples.rays[:, 1].max() - samples.rays[:, 1].min())

    def plausible(planes: Tensor) -> Tensor:
        # Nearer towards the bottom of the picture is seen from above; a / b is the tangent of the camera's roll.
        level: Tensor = planes[..., 0].abs() <= math.tan(math.radians(max_roll_deg)) * planes[..., 1]
        if up is not None:
            level = level & (-(planes @ up.to(planes)) > _UP_COSINE * torch.linalg.vector_norm(planes, dim=-1))
        return level & (planes[..., 1] > slope)

    odds = samples.weight[index].float().cpu()
    drawn = torch.multinomial(odds, 3 * hypotheses, replacement=True, generator=generator).to(index.device)
    triples = index[drawn].view(hypotheses, 3)
    planes, singular = torch.linalg.solve_ex(samples.rays[triples], samples.inverse[triples])
    planes = planes[(singular == 0) & torch.isfinite(planes).all(-1) & plausible(planes)]
    if not len(planes):
        return "no_consensus"
    counted = samples.candidate | samples.watched
    if int(counted.sum()) > 2 * _SCORED_SAMPLES:
        order = torch.randperm(len(counted), generator=generator).to(counted.device)
        some = order[counted[order]][:_SCORED_SAMPLES]
        best = _score(samples, planes, band, some).topk(min(_FINALISTS, len(planes))).indices
        planes = planes[best]
    best_first = _score(samples, planes, band, counted.nonzero()[:, 0]).argmax()
    plane: Tensor = planes[best_first]
    for _ in range(_REFITS):
        error = (samples.inverse - samples.rays @ plane) / band
        weight = samples.weight * samples.candidate * (1 - error.square()).clamp(min=0).square()
        weighted = samples.rays * weight[:, None]
        moments = weighted.T @ samples.rays
        if up is not None:
            # The part of the plane across up is an angle times its length: as if seen with an error of that angle.
            across = torch.eye(3, dtype=plane.dtype, device=plane.device) - torch.outer(up, up).to(plane)
            angle = float(torch.linalg.vector_norm(plane)) * _UP_SIGMA
            moments = moments + _UP_SHARE * weight.sum() * (band / angle) ** 2 * across
        refit, singular = torch.linalg.solve_ex(moments, weighted.T @ samples.inverse)
        if int(singular) != 0 or not bool(plausible(refit)):
            break
        plane = refit
    return plane


def _score(samples: _Samples, planes: Tensor, band: float, some: Tensor) -> Tensor:
    """(G,) weight on each plane less weight clearly below it; what is lower in the picture counts up to double."""
    rays, inverse = samples.rays[some].float(), samples.inverse[some].float()
    low, high = rays[:, 1].min(), rays[:, 1].max()
    weight = samples.weight[some].float() * (1 + (rays[:, 1] - low) / (high - low).clamp(min=1e-12))
    error = inverse - planes.float() @ rays.T
    on = (error.abs() < band).float() @ (weight * samples.candidate[some])
    below = (error < -2 * band).float() @ (weight * samples.watched[some])
    return on - below


def _shares(samples: _Samples, plane: Tensor, band: float) -> tuple[float, float]:
    error = samples.inverse - samples.rays @ plane

    def share(found: Tensor, among: Tensor) -> float:
        weight = samples.weight * among
        return float((weight * found).sum() / weight.sum()) if bool(among.any()) else 0.0

    return share(error.abs() < band, samples.candidate), share(error < -2 * band, samples.watched)


def _feet_factors(
    plane: Tensor, rays: Tensor, inverse: Tensor, valid: Tensor, feet_px: Tensor | None, band: float, share: float
) -> Tensor:
    """Inverse depth seen over inverse depth of the plane, for each foot that the plane can be compared with.

    ``share`` of the longer side is how far round a foot valid pixels are looked at.
    """
    rows, columns = valid.shape
    reach = max(2, round(share * max(rows, columns)))
    factors = []
    for u, v in [] if feet_px is None else feet_px.round().long().tolist():
        window = (slice(max(0, v - reach), max(0, v + reach + 1)), slice(max(0, u - reach), max(0, u + reach + 1)))
        seen = valid[window]
        expected = rays[window][seen] @ plane.to(rays)
        near = expected > 2 * band
        if bool(near.any()):
            factors.append(float((inverse[window][seen][near] / expected[near]).median()))
    return torch.tensor(factors, dtype=torch.float64)


def _reanchored(fit: PlaneFit, factors: Tensor) -> PlaneFit:
    """Scale a plane's inverse depth so that it passes through the pixels at the feet; its normal stays."""
    if not len(factors):
        return fit
    factor = float(factors.quantile(0.5))
    if not _REANCHOR_RANGE[0] < factor < _REANCHOR_RANGE[1]:
        return fit
    return replace(fit, offset=fit.offset / factor, reanchored=factor)
