"""The floor: finding its plane in a point map, and putting points on it.

A plane n . X + o = 0 is linear in the inverse depth: with the ray (x, y, 1) = X / Z of a pixel, 1 / Z = a x + b y + c,
where n = -(a, b, c) / |(a, b, c)| and o = 1 / |(a, b, c)|. Fitting there needs no scale and no metres, and gives what is
far away, and badly known, the small weight that it deserves: :func:`fit_floor`. :func:`fit_floor_metric` is the
paper's way. Heights are n . X + o: positive above, and o is the height of the camera.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import torch
from torch import Tensor

__all__ = ["FloorSearch", "PlaneFit", "fit_floor", "fit_floor_metric", "height", "plane_basis", "sample_plane"]

FloorReason = Literal["found", "no_pixels", "no_consensus", "below_plane", "switched_off"]
"""Why a search ended: "found"; too few pixels to look at; too small a share on any level plane; too many valid pixels
clearly below the best plane, which then is a table and not the floor; or nobody asked."""

_SAMPLES = 16_000
_FEWEST_SAMPLES = 40
_SCORED_SAMPLES = 2000
_FINALISTS = 32
_REFITS = 8
_STEEPEST_NORMAL = 0.25
_FEET_WINDOW = 0.006
_REANCHOR_RANGE = (0.5, 2.0)


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


def height(points: Tensor, normal: Tensor, offset: float | Tensor) -> Tensor:
    """Signed height of points (..., 3) over a plane: (...), the unit of the points."""
    return points @ normal.to(points) + offset


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
    hypotheses: int = 1000,
    min_share: float = 0.3,
    mask_min_share: float = 0.5,
    max_below: float = 0.1,
    max_roll_deg: float = 25.0,
    hole_weight: float = 0.3,
    lower_share: float = 0.6,
    seed: int = 0,
) -> FloorSearch:
    """Find the floor of a point map in inverse depth.

    First among the pixels of ``floor_mask``, where given; if nothing there passes the checks, among the lower part of
    the picture, where the plane must be seen from above and level within ``max_roll_deg``. The feet do not take part in
    the search (they would make the slope a local one): they only move the plane found, its horizon kept.

    Args:
        points: (H, W, 3), any unit, preferably of the photo without its people.
        valid: (H, W) bool.
        floor_mask: (H, W) bool, pixels that a segmenter calls floor, or None.
        hole: (H, W) bool, pixels that an inpainter made up, or None.
        feet_px: (F, 2) px, floor pixels at people's soles; where empty or None the plane is not moved.
        tolerance: of an inlier, as a share of the range of the inverse depth.
        hypotheses: planes drawn.
        min_share: share of the lower part's pixels that must lie on the plane.
        mask_min_share: share of the mask's pixels that must lie on the plane.
        max_below: largest share of the lower part's pixels that may lie two tolerances or more below it.
        max_roll_deg: largest sideways tilt.
        hole_weight: weight of the pixels of ``hole``.
        lower_share: the lower part of the picture.
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
    band = tolerance * _range(known)
    if not band > 0:
        return FloorSearch(None, "no_consensus")

    def search(mask: Tensor | None, share: float) -> FloorSearch:
        samples = _sample(rays, inverse, valid, mask, hole, hole_weight, lower_share)
        generator = torch.Generator().manual_seed(seed)
        plane = _fit_samples(samples, band, hypotheses, max_roll_deg, generator, steep=mask is not None)
        if isinstance(plane, str):
            return FloorSearch(None, plane)
        on, below = _shares(samples, plane, band)
        if on <= share:
            return FloorSearch(None, "no_consensus", on, below)
        if below > max_below:
            return FloorSearch(None, "below_plane", on, below)
        expected = rays @ plane.to(rays)
        inliers = valid & ((inverse - expected).abs() < band) & (expected > 2 * band)
        source: Literal["floor mask", "lower image"] = "lower image" if mask is None else "floor mask"
        length = float(torch.linalg.vector_norm(plane))
        fit = PlaneFit(-(plane / length).to(points), 1 / length, inliers, on, below, source)
        return FloorSearch(_reanchor(fit, rays, inverse, valid, feet_px, band), "found", on, below)

    if floor_mask is None or not bool(floor_mask.any()):
        return search(None, min_share)
    masked = search(floor_mask, mask_min_share)
    return masked if masked.plane is not None else replace(search(None, min_share), mask_reason=masked.reason)


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
    samples: _Samples, band: float, hypotheses: int, max_roll_deg: float, generator: torch.Generator, steep: bool
) -> Tensor | FloorReason:
    """RANSAC, then least squares on the consensus: (3,) plane a, b, c."""
    index = samples.candidate.nonzero()[:, 0]
    if len(index) < _FEWEST_SAMPLES:
        return "no_pixels"
    slope = 0.05 * band / 0.012 / float(samples.rays[:, 1].max() - samples.rays[:, 1].min())

    def plausible(planes: Tensor) -> Tensor:
        a, b = planes[..., 0], planes[..., 1]
        if steep:  # A mask is trusted with a floor seen from straight above as well.
            length = torch.linalg.vector_norm(planes, dim=-1)
            return (a.abs() <= math.sin(math.radians(max_roll_deg)) * length) & (b >= -_STEEPEST_NORMAL * length)
        return (b > slope) & (a.abs() <= math.tan(math.radians(max_roll_deg)) * b)

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
        refit, singular = torch.linalg.solve_ex(weighted.T @ samples.rays, weighted.T @ samples.inverse)
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


def _reanchor(
    fit: PlaneFit, rays: Tensor, inverse: Tensor, valid: Tensor, feet_px: Tensor | None, band: float
) -> PlaneFit:
    """Scale a plane's inverse depth so that it passes through the pixels at the feet; its normal stays."""
    if feet_px is None or not len(feet_px):
        return fit
    rows, columns = valid.shape
    reach = max(2, round(_FEET_WINDOW * max(rows, columns)))
    plane = -fit.normal / fit.offset
    ratios = []
    for u, v in feet_px.round().long().tolist():
        window = (slice(max(0, v - reach), max(0, v + reach + 1)), slice(max(0, u - reach), max(0, u + reach + 1)))
        seen = valid[window]
        if not bool(seen.any()):
            continue
        expected = rays[window][seen] @ plane.to(rays)
        near = expected > 2 * band
        if bool(near.any()):
            ratios.append(float((inverse[window][seen][near] / expected[near]).median()))
    if not ratios:
        return fit
    factor = float(torch.tensor(ratios, dtype=torch.float64).quantile(0.5))
    if not _REANCHOR_RANGE[0] < factor < _REANCHOR_RANGE[1]:
        return fit
    return replace(fit, offset=fit.offset / factor, reanchored=factor)


def fit_floor_metric(
    points: Tensor,
    normals: Tensor,
    valid: Tensor,
    floor_mask: Tensor | None,
    *,
    tolerance_m: float = 0.01,
    max_angle_deg: float = 30.0,
    hypotheses: int = 200,
    min_share: float = 0.0,
    max_below: float = 1.0,
    seed: int = 0,
) -> FloorSearch:
    """Find the floor among the points of a floor mask, by positions and normals (paper Sec. 3.1).

    Args:
        points: (H, W, 3) metres.
        normals: (H, W, 3) unit, zero where unreliable.
        valid: (H, W) bool.
        floor_mask: (H, W) bool; without one there is no floor, as in the paper.
        tolerance_m: of an inlier, metres.
        max_angle_deg: between an inlier's normal and the plane's.
        hypotheses: planes drawn.
        min_share: share of the mask's points that must lie on the plane.
        max_below: largest share of valid points that may lie more than ten tolerances below it.
        seed: of the draws.
    """
    if floor_mask is None:
        return FloorSearch(None, "no_pixels")
    candidate = floor_mask & valid & (normals != 0).any(-1)
    cloud, directions = points[candidate].double(), normals[candidate].double()
    if len(cloud) < _FEWEST_SAMPLES:
        return FloorSearch(None, "no_pixels")
    generator = torch.Generator().manual_seed(seed)
    triples = torch.randint(len(cloud), (hypotheses, 3), generator=generator).to(cloud.device)
    corner = cloud[triples]
    raw = torch.linalg.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = torch.linalg.vector_norm(raw, dim=-1)
    flat = length > 1e-12
    normal = raw[flat] / length[flat, None]
    offset = -(normal * corner[flat, 0]).sum(-1)
    if not len(normal):
        return FloorSearch(None, "no_consensus")
    some = torch.randperm(len(cloud), generator=generator)[:_SAMPLES].to(cloud.device)
    aligned = math.cos(math.radians(max_angle_deg))

    def on_plane(n: Tensor, o: Tensor, p: Tensor, d: Tensor) -> Tensor:
        return ((n @ p.T + o[..., None]).abs() < tolerance_m) & ((n @ d.T).abs() > aligned)

    votes = torch.cat(
        [
            on_plane(n, o, cloud[some], directions[some]).sum(-1)
            for n, o in zip(normal.split(64), offset.split(64), strict=True)
        ]
    )
    best = int(votes.argmax())
    n, o = normal[best], offset[best]
    for _ in range(_REFITS):
        inlier = on_plane(n, o, cloud, directions)
        if int(inlier.sum()) < 3:
            return FloorSearch(None, "no_consensus")
        n, o = _principal_plane(cloud[inlier])
    if float(o) < 0:
        n, o = -n, -o
    share = float(on_plane(n, o, cloud, directions).double().mean())
    below = float((height(points[valid].double(), n, o) < -10 * tolerance_m).double().mean())
    if share <= min_share:
        return FloorSearch(None, "no_consensus", share, below)
    if below > max_below:
        return FloorSearch(None, "below_plane", share, below)
    inliers = valid & (height(points, n, float(o)).abs() < tolerance_m)
    fit = PlaneFit(n.to(points), float(o), inliers, share, below, "floor mask")
    return FloorSearch(fit, "found", share, below)


def _principal_plane(cloud: Tensor) -> tuple[Tensor, Tensor]:
    """The plane of smallest squared distance to (M, 3) points."""
    centre = cloud.mean(0)
    spread = cloud - centre
    normal = torch.linalg.eigh(spread.T @ spread).eigenvectors[:, 0]
    return normal, -(normal @ centre)


def plane_basis(normal: Tensor) -> tuple[Tensor, Tensor]:
    """Two unit vectors (3,) that span the plane: the first sideways in the picture where it can be, and their cross
    product is the normal."""
    side = normal.new_tensor([1.0, 0.0, 0.0])
    if abs(float(normal[0])) > 0.9:
        side = normal.new_tensor([0.0, 0.0, 1.0])
    first = side - (side @ normal) * normal
    first = first / torch.linalg.vector_norm(first)
    return first, torch.linalg.cross(normal, first)


def sample_plane(
    normal: Tensor,
    offset: float,
    points: Tensor,
    *,
    centres: Tensor | None = None,
    spacing: float = 0.025,
    near: float = 1.5,
    max_points: int = 40_000,
    grid: int = 0,
) -> Tensor:
    """Points on a plane over the extent of a scene, in the plane's own coordinates, so that any plane will do.

    The extent is the 2nd to 98th percentile of the scene along both axes of the plane. The lattice has ``spacing``
    within ``near`` of the centres, and beyond that whatever spacing the number of points allows.

    Args:
        normal: (3,) unit.
        offset: of the plane.
        points: (M, 3) of the scene, metres.
        centres: (P, 3) where people stand or sit; the nearest scene point where None or empty.
        spacing: metres, near the centres.
        near: metres.
        max_points: points at most.
        grid: a plain grid of ``grid`` x ``grid`` points over the extent instead (paper; 100 in the released code).

    Returns:
        (N, 3) metres; N = 0 where there is no scene.
    """
    if not len(points) or (max_points < 1 and not grid):
        return points.new_zeros((0, 3))
    axes = torch.stack(plane_basis(normal))
    origin = -offset * normal
    flat = (points[:: max(1, len(points) // 100_000)] - origin) @ axes.T
    low, high = (_percentile(flat, q) for q in (0.02, 0.98))
    if grid:
        lines = [torch.linspace(float(low[i]), float(high[i]), grid, dtype=flat.dtype) for i in (0, 1)]
        return _lift(torch.cartesian_prod(*lines).to(flat), origin, axes)
    if centres is None or not len(centres):
        centres = points[torch.linalg.vector_norm(points, dim=-1).argmin()][None]
    middles = (centres - origin) @ axes.T
    # Half of the points at most go to the neighbourhoods.
    fine = max(spacing, math.sqrt(2 * len(middles) * math.pi * near**2 / max_points))
    close = _discs(middles, near, fine)
    left = max_points - len(close)
    area = float((high - low).clamp(min=1e-6).prod())
    coarse = max(fine, math.sqrt(area / max(1, left)))
    counts = ((high - low) / coarse).floor().clamp(min=0).long() + 1
    while int(counts.prod()) > left > 0:
        coarse *= 1.02
        counts = ((high - low) / coarse).floor().clamp(min=0).long() + 1
    if left <= 0:
        return _lift(close[:max_points], origin, axes)
    lines = [float(low[i]) + coarse * torch.arange(int(counts[i]), dtype=flat.dtype) for i in (0, 1)]
    wide = torch.cartesian_prod(*lines).to(flat)
    wide = wide[(torch.cdist(wide, middles) > near).all(-1)]
    return _lift(torch.cat((close, wide)), origin, axes)


def _discs(middles: Tensor, radius: float, spacing: float) -> Tensor:
    """(N, 2) points of one common lattice within ``radius`` of any of (P, 2) middles, each once."""
    reach = math.ceil(radius / spacing) + 1
    step = torch.arange(-reach, reach + 1, device=middles.device)
    around = torch.cartesian_prod(step, step)
    cells = []
    for middle in middles:
        cell = (middle / spacing).round().long() + around
        cells.append(cell[torch.linalg.vector_norm(cell * spacing - middle, dim=-1) <= radius])
    once: Tensor = torch.unique(torch.cat(cells), dim=0)  # type: ignore[no-untyped-call]
    return once.to(middles) * spacing


def _percentile(x: Tensor, share: float) -> Tensor:
    """(C,) of (M, C); by sorting, since torch.quantile refuses large inputs."""
    return x.sort(dim=0).values[round(share * (len(x) - 1))]


def _lift(flat: Tensor, origin: Tensor, axes: Tensor) -> Tensor:
    return origin + flat @ axes
