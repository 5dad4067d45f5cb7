"""Planes of a point map in inverse depth, found by RANSAC and least squares. OpenCV camera frame.

A plane n . X + o = 0 is linear in inverse depth: with the ray (x, y, 1) = X / Z of a pixel, 1 / Z =
a x + b y + c, where ``n = -(a, b, c) / |(a, b, c)|`` and ``o = 1 / |(a, b, c)|``. A fit in inverse
depth needs no scale, and uncertain distant points have little weight. Inverse depth is averaged
over square pixel blocks to reduce noise. The mean is exact on a plane.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import torch
from torch import Tensor

from physic_core.geometry.pixels import all_finite, quantiles, select_pixels

LOWER_SHARE = 0.6
"""Height of the lower part of the image, in which a floor is searched without a mask."""

FEWEST_SAMPLES = 40

HOLE_WEIGHT = 0.3
"""Weight of inpainted pixels: an inpainter may continue furniture instead of the floor."""

MAX_ROLL_DEG = 25.0
"""Largest roll of the camera relative to the floor, if up is not known."""

_HYPOTHESES = 1000
_SEED = 0
_SAMPLES = 16_000
_SCORED_SAMPLES = 2000
_SCORED_ERRORS = 512_000  # at a time, of planes at samples
_FINALISTS = 32  # hypotheses that are scored on all samples
_REFITS = 8
_UP_COSINE = math.cos(math.radians(15.0))  # least cosine between a floor's normal and up
_UP_SIGMA = math.radians(3.0)  # standard error of the up direction
_UP_SHARE = 0.05  # weight of the up direction as a share of the pixels' weight
_TOLERANCE = 0.02  # largest error of an inlier, as a share of the range of inverse depth
_LEAST_RISE = 0.05  # least increase of inverse depth from top to bottom, as a share of its range


class _BlockMeans(NamedTuple):
    share: Tensor  # (h, w) of pixels that are valid
    rays: Tensor  # (h, w, 3)
    inverse: Tensor  # (h, w)
    weight: Tensor  # (h, w), less for inpainted pixels


@dataclass(frozen=True)
class InverseDepthMap:
    """A point map as inverse depth over rays.

    Attributes:
        rays: (H, W, 3), X / Z, zero where not valid.
        inverse: (H, W), 1 / Z.
        valid: (H, W) bool.
        tolerance: inverse depth.
        least_rise: inverse depth.
        hole: (H, W) bool, inpainted pixels; None without any.
    """

    rays: Tensor
    inverse: Tensor
    valid: Tensor
    tolerance: float
    least_rise: float
    hole: Tensor | None
    _means: dict[int, _BlockMeans] = field(default_factory=dict, init=False, repr=False)

    def block_means(self, block: int) -> _BlockMeans:
        """Return the means over square blocks of pixels, computed once for each side."""
        if block not in self._means:
            share = _block_mean(self.valid.to(self.inverse), block)
            scale = share.clamp(min=torch.finfo(share.dtype).tiny).reciprocal()
            rays = [_block_mean(plane, block) * scale for plane in self.rays.unbind(-1)]
            weight = torch.ones_like(share)
            if self.hole is not None:
                weight = 1 - (1 - HOLE_WEIGHT) * _block_mean(self.hole.to(share), block)
            inverse = _block_mean(self.inverse, block) * scale
            self._means[block] = _BlockMeans(share, torch.stack(rays, -1), inverse, weight)
        return self._means[block]

    def error(self, by_ray: Tensor) -> Tensor:
        """Return the error (H, W) in inverse depth of a plane, by its inverse depth (3,) by ray;
        positive for pixels in front of it.
        """
        return self.inverse - self.rays @ by_ray.to(self.rays)


def inverse_depth_map(
    points: Tensor, valid: Tensor, hole: Tensor | None = None
) -> InverseDepthMap | None:
    """Convert a point map (H, W, 3), valid (H, W), of any unit; None with too few pixels or a
    single depth.
    """
    valid = valid & all_finite(points) & (points[..., 2] > 0)
    inverse = torch.where(valid, 1 / points[..., 2], 0.0)
    rays = torch.where(valid[..., None], points * inverse[..., None], 0.0)
    (known,) = select_pixels(valid, inverse)
    if len(known) < FEWEST_SAMPLES:
        return None
    low, high = quantiles(known, (0.01, 0.99))
    spread = high - low
    if not _TOLERANCE * spread > 0:
        return None
    return InverseDepthMap(rays, inverse, valid, _TOLERANCE * spread, _LEAST_RISE * spread, hole)


class BlockMeans(NamedTuple):
    """Means over M blocks of pixels.

    Attributes:
        rays: (M, 3) mean ray (x, y, 1).
        inverse: (M,) mean inverse depth.
        weight: (M,) less for inpainted pixels.
        candidate: (M,) bool, blocks of the mask, or of the lower part of the image without a mask.
        lower: (M,) bool, blocks of the lower part, in which pixels below a plane count against it.
    """

    rays: Tensor
    inverse: Tensor
    weight: Tensor
    candidate: Tensor
    lower: Tensor


def average_blocks(view: InverseDepthMap, mask: Tensor | None) -> BlockMeans:
    """Average the rays and inverse depths of a point map over square blocks of pixels.

    Args:
        view: the point map.
        mask: (H, W) bool, candidate pixels; None takes the lower part of the image.
    """
    rows, columns = view.valid.shape
    block = max(1, math.ceil(math.sqrt(rows * columns / _SAMPLES)))
    while True:
        block_means = view.block_means(block)
        share = block_means.share
        candidate = share > 0
        if mask is not None:
            candidate &= _block_mean((mask & view.valid).to(share), block) > 0.5 * share
        if mask is None or block == 1 or int(candidate.sum()) >= 10 * FEWEST_SAMPLES:
            break
        block = block // 2
    down = torch.linspace(0, 1, len(share), dtype=share.dtype)[:, None].expand(share.shape)
    lower = down >= 1 - LOWER_SHARE
    is_known = share > 0
    return BlockMeans(
        rays=block_means.rays[is_known].double(),
        inverse=block_means.inverse[is_known].double(),
        weight=block_means.weight[is_known].double(),
        candidate=(candidate if mask is not None else lower & candidate)[is_known],
        lower=lower[is_known],
    )


def _block_mean(x: Tensor, block: int) -> Tensor:
    """Return the mean of x (H, W) over block x block pixels; blocks at the border may be
    smaller.
    """
    return torch.nn.functional.avg_pool2d(x[None, None], block, ceil_mode=True)[0, 0]


def fit_plane(
    samples: BlockMeans, tolerance: float, least_rise: float, up: Tensor | None
) -> Tensor | None:
    """Fit a plane to the candidate blocks by RANSAC and reweighted least squares.

    Args:
        samples: at least ``FEWEST_SAMPLES`` candidates.
        tolerance: largest error of an inlier, inverse depth.
        least_rise: least increase of inverse depth from the top of the image to its bottom.
        up: (3,) unit up direction, or None.

    Returns:
        (3,) plane a, b, c, which points down; None without a valid hypothesis.
    """
    height = float(samples.rays[:, 1].max() - samples.rays[:, 1].min())
    if not height > 0:
        return None
    slope = least_rise / height
    generator = torch.Generator().manual_seed(_SEED)
    planes = _draw_planes(samples, slope, up, generator)
    if not len(planes):
        return None
    counted = samples.candidate | samples.lower
    if int(counted.sum()) > 2 * _SCORED_SAMPLES:
        order = torch.randperm(len(counted), generator=generator)
        some = order[counted[order]][:_SCORED_SAMPLES]
        planes = planes[
            _score(samples, planes, tolerance, some).topk(min(_FINALISTS, len(planes))).indices
        ]
    best = _score(samples, planes, tolerance, counted.nonzero()[:, 0]).argmax()
    return _refine_plane(samples, planes[best], tolerance, slope, up)


def _draw_planes(
    samples: BlockMeans, slope: float, up: Tensor | None, generator: torch.Generator
) -> Tensor:
    """Return valid planes (G, 3) through three random candidates each."""
    index = samples.candidate.nonzero()[:, 0]
    odds = samples.weight[index].float()
    drawn = torch.multinomial(odds, 3 * _HYPOTHESES, replacement=True, generator=generator)
    triples = index[drawn].view(_HYPOTHESES, 3)
    planes = planes_through(samples.rays, samples.inverse, triples)
    return planes[_is_level(planes, slope, up)]


def planes_through(rays: Tensor, inverse: Tensor, triples: Tensor) -> Tensor:
    """Return the finite planes (G, 3) through triples (M, 3) int64 of pixels with rays (P, 3) and
    inverse depths (P,).
    """
    planes, singular = torch.linalg.solve_ex(rays[triples], inverse[triples])
    regular: Tensor = planes[(singular == 0) & torch.isfinite(planes).all(-1)]
    return regular


def weighted_plane(
    rays: Tensor, inverse: Tensor, weight: Tensor, prior: Tensor | float = 0.0
) -> Tensor | None:
    """Return the plane (3,) of least squares through pixels with rays (P, 3), inverse depths (P,)
    and weights (P,), whose moments (3, 3) have a prior; None if the rays are in one plane.
    """
    # Not lstsq: the last bit of its solution depends on where LAPACK's work space lies in memory.
    weighted = (rays * weight[:, None]).T
    plane, singular = torch.linalg.solve_ex(weighted @ rays + prior, weighted @ inverse)
    return None if int(singular) else plane


def _is_level(planes: Tensor, slope: float, up: Tensor | None) -> Tensor:
    """Return whether planes (..., 3) are seen from above, unrolled and perpendicular to up: (...)
    bool.
    """
    # Inverse depth increases downwards on a plane seen from above; a / b is the tangent of the
    # camera's roll.
    if up is None:
        level: Tensor = (
            planes[..., 0].abs() <= math.tan(math.radians(MAX_ROLL_DEG)) * planes[..., 1]
        )
    else:
        level = -(planes @ up.to(planes)) > _UP_COSINE * torch.linalg.vector_norm(planes, dim=-1)
    return level & (planes[..., 1] > slope)


def _refine_plane(
    samples: BlockMeans, plane: Tensor, tolerance: float, slope: float, up: Tensor | None
) -> Tensor:
    for _ in range(_REFITS):
        error = (samples.inverse - samples.rays @ plane) / tolerance
        weight = samples.weight * samples.candidate * (1 - error.square()).clamp(min=0).square()
        prior: Tensor | float = 0.0
        if up is not None:
            # A prior on the component perpendicular to up, which is the angle between them times
            # the length.
            across = torch.eye(3, dtype=plane.dtype) - torch.outer(up, up).to(plane)
            up_sigma = float(torch.linalg.vector_norm(plane)) * _UP_SIGMA
            prior = _UP_SHARE * weight.sum() * (tolerance / up_sigma) ** 2 * across
        refitted = weighted_plane(samples.rays, samples.inverse, weight, prior)
        if refitted is None or not _is_level(refitted, slope, up):
            break
        plane = refitted
    return plane


def _score(samples: BlockMeans, planes: Tensor, tolerance: float, some: Tensor) -> Tensor:
    """Return the weight (G,) of the inliers minus that of blocks below; weights double towards the
    bottom.
    """
    rays = samples.rays[some].float()
    inverse = samples.inverse[some].float()
    low = rays[:, 1].min()
    high = rays[:, 1].max()
    weight = samples.weight[some].float() * (1 + (rays[:, 1] - low) / (high - low).clamp(min=1e-12))
    counted = weight * samples.candidate[some]
    against = weight * samples.lower[some]

    def score(planes: Tensor) -> Tensor:
        error = inverse - planes @ rays.T
        on = (error.abs() < tolerance).float() @ counted
        return on - (error < -2 * tolerance).float() @ against

    # A part at a time lies in the processor's cache: half of the time of all at once, and .25 GB
    # less where few pixels of a floor are seen and each is a sample.
    parts = torch.split(planes.float(), max(1, _SCORED_ERRORS // max(1, len(some))))
    return torch.cat([score(part) for part in parts])


def refit(rays: Tensor, inverse: Tensor, tolerance: float) -> Tensor:
    """Fit a plane (3,) to pixels (M, 3), (M,) that mostly lie on it, by least squares, then
    reweighted ones.

    It is 0, at infinity, where the rays of the pixels are in one plane.
    """
    plane = torch.zeros_like(rays[0])
    weight = torch.ones_like(inverse)
    for _ in range(1 + _REFITS):
        again = weighted_plane(rays, inverse, weight)
        if again is None:
            break
        plane = again
        weight = (1 - ((inverse - rays @ plane) / tolerance).square()).clamp(min=0).square()
    return plane


def lower_inlier_shares(view: InverseDepthMap, plane: Tensor) -> tuple[float, float]:
    """Return :func:`plane_inlier_shares` of the lower part of the image."""
    return plane_inlier_shares(average_blocks(view, None), plane, view.tolerance)


def plane_inlier_shares(
    samples: BlockMeans, plane: Tensor, tolerance: float
) -> tuple[float, float]:
    """Return two shares: of the candidates on a plane, and of the lower blocks over two tolerances
    below it.

    Args:
        samples: blocks of inverse depth.
        plane: (3,) whose product with a ray is the inverse depth.
        tolerance: of inverse depth.
    """
    error = samples.inverse - samples.rays @ plane

    def share(inliers: Tensor, among: Tensor) -> float:
        weight = samples.weight * among
        return float((weight * inliers).sum() / weight.sum()) if among.any() else 0.0

    return share(error.abs() < tolerance, samples.candidate), share(
        error < -2 * tolerance, samples.lower
    )
