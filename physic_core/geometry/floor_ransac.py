"""RANSAC for a floor in inverse depth: 1 / Z = a x + b y + c for the pixel ray (x, y, 1).

Inverse depth is averaged over square pixel blocks to reduce noise. The mean is exact on a plane.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

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
_FINALISTS = 32  # hypotheses that are scored on all samples
_REFITS = 8
_UP_COSINE = math.cos(math.radians(15.0))  # least cosine between a floor's normal and up
_UP_SIGMA = math.radians(3.0)  # standard error of the up direction
_UP_SHARE = 0.05  # weight of the up direction as a share of the pixels' weight


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


def average_blocks(
    rays: Tensor, inverse: Tensor, valid: Tensor, mask: Tensor | None, hole: Tensor | None
) -> BlockMeans:
    """Average the rays and inverse depths of a point map over square blocks of pixels.

    Args:
        rays: (H, W, 3), X / Z.
        inverse: (H, W), 1 / Z.
        valid: (H, W) bool.
        mask: (H, W) bool, candidate pixels; None takes the lower part of the image.
        hole: (H, W) bool, inpainted pixels, or None.
    """
    rows, columns = valid.shape
    block = max(1, math.ceil(math.sqrt(rows * columns / _SAMPLES)))
    while True:
        share = _block_mean(valid.to(inverse), block)
        candidate = share > 0
        if mask is not None:
            candidate &= _block_mean((mask & valid).to(inverse), block) > 0.5 * share
        if mask is None or block == 1 or int(candidate.sum()) >= 10 * FEWEST_SAMPLES:
            break
        block = block // 2
    scale = share.clamp(min=torch.finfo(share.dtype).tiny).reciprocal()
    mean_inverse = _block_mean(inverse, block) * scale
    mean_rays = torch.stack([_block_mean(rays[..., i], block) * scale for i in range(3)], -1)
    down = torch.linspace(0, 1, len(share), dtype=share.dtype, device=share.device)[:, None].expand(share.shape)
    lower = down >= 1 - LOWER_SHARE
    weight = torch.ones_like(share)
    if hole is not None:
        weight = 1 - (1 - HOLE_WEIGHT) * _block_mean(hole.to(inverse), block)
    known = share > 0
    return BlockMeans(
        rays=mean_rays[known].double(),
        inverse=mean_inverse[known].double(),
        weight=weight[known].double(),
        candidate=(candidate if mask is not None else lower & candidate)[known],
        lower=lower[known],
    )


def _block_mean(x: Tensor, block: int) -> Tensor:
    """Return the mean of x (H, W) over block x block pixels; blocks at the border may be smaller."""
    if block == 1:
        return x
    blocks: Tensor = torch.nn.functional.avg_pool2d(x[None, None], block, ceil_mode=True)[0, 0]
    return blocks


def fit_plane(samples: BlockMeans, tolerance: float, least_rise: float, up: Tensor | None) -> Tensor | None:
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
        order = torch.randperm(len(counted), generator=generator).to(counted.device)
        some = order[counted[order]][:_SCORED_SAMPLES]
        planes = planes[_score(samples, planes, tolerance, some).topk(min(_FINALISTS, len(planes))).indices]
    best = _score(samples, planes, tolerance, counted.nonzero()[:, 0]).argmax()
    return _refine(samples, planes[best], tolerance, slope, up)


def _draw_planes(samples: BlockMeans, slope: float, up: Tensor | None, generator: torch.Generator) -> Tensor:
    """Return valid planes (G, 3) through three random candidates each."""
    index = samples.candidate.nonzero()[:, 0]
    odds = samples.weight[index].float().cpu()
    drawn = torch.multinomial(odds, 3 * _HYPOTHESES, replacement=True, generator=generator).to(index.device)
    triples = index[drawn].view(_HYPOTHESES, 3)
    planes, singular = torch.linalg.solve_ex(samples.rays[triples], samples.inverse[triples])
    planes = planes[(singular == 0) & torch.isfinite(planes).all(-1)]
    level: Tensor = planes[_is_level(planes, slope, up)]
    return level


def _is_level(planes: Tensor, slope: float, up: Tensor | None) -> Tensor:
    """Return whether planes (..., 3) are seen from above, unrolled and perpendicular to up: (...) bool."""
    # Inverse depth increases downwards on a plane seen from above; a / b is the tangent of the camera's roll.
    if up is None:
        level: Tensor = planes[..., 0].abs() <= math.tan(math.radians(MAX_ROLL_DEG)) * planes[..., 1]
    else:
        level = -(planes @ up.to(planes)) > _UP_COSINE * torch.linalg.vector_norm(planes, dim=-1)
    return level & (planes[..., 1] > slope)


def _refine(samples: BlockMeans, plane: Tensor, tolerance: float, slope: float, up: Tensor | None) -> Tensor:
    for _ in range(_REFITS):
        error = (samples.inverse - samples.rays @ plane) / tolerance
        weight = samples.weight * samples.candidate * (1 - error.square()).clamp(min=0).square()
        weighted = samples.rays * weight[:, None]
        moments = weighted.T @ samples.rays
        if up is not None:
            # A prior on the component perpendicular to up, which is the angle between them times the length.
            across = torch.eye(3, dtype=plane.dtype, device=plane.device) - torch.outer(up, up).to(plane)
            angle = float(torch.linalg.vector_norm(plane)) * _UP_SIGMA
            moments = moments + _UP_SHARE * weight.sum() * (tolerance / angle) ** 2 * across
        refit, singular = torch.linalg.solve_ex(moments, weighted.T @ samples.inverse)
        if int(singular) != 0 or not bool(_is_level(refit, slope, up)):
            break
        plane = refit
    return plane


def _score(samples: BlockMeans, planes: Tensor, tolerance: float, some: Tensor) -> Tensor:
    """Return the weight (G,) of the inliers minus that of blocks below; weights double towards the bottom."""
    rays, inverse = samples.rays[some].float(), samples.inverse[some].float()
    low, high = rays[:, 1].min(), rays[:, 1].max()
    weight = samples.weight[some].float() * (1 + (rays[:, 1] - low) / (high - low).clamp(min=1e-12))
    error = inverse - planes.float() @ rays.T
    on = (error.abs() < tolerance).float() @ (weight * samples.candidate[some])
    below = (error < -2 * tolerance).float() @ (weight * samples.lower[some])
    return on - below


def refit(rays: Tensor, inverse: Tensor, tolerance: float) -> Tensor:
    """Fit a plane (3,) to pixels (M, 3), (M,) that mostly lie on it, by least squares, then reweighted ones.

    It is 0, at infinity, where the rays of the pixels are in one plane.
    """
    plane, weight = torch.zeros_like(rays[0]), torch.ones_like(inverse)
    # Not lstsq: the last bit of its solution depends on where LAPACK's work space lies in memory.
    for _ in range(1 + _REFITS):
        weighted = rays * weight[:, None]
        again, singular = torch.linalg.solve_ex(weighted.T @ rays, weighted.T @ inverse)
        if int(singular) != 0:
            break
        plane = again
        weight = (1 - ((inverse - rays @ plane) / tolerance).square()).clamp(min=0).square()
    return plane


def plane_inlier_shares(samples: BlockMeans, plane: Tensor, tolerance: float) -> tuple[float, float]:
    """Return two shares: of the candidates on a plane, and of the lower blocks over two tolerances below it.

    Args:
        samples: blocks of inverse depth.
        plane: (3,) whose product with a ray is the inverse depth.
        tolerance: of inverse depth.
    """
    error = samples.inverse - samples.rays @ plane

    def share(found: Tensor, among: Tensor) -> float:
        weight = samples.weight * among
        return float((weight * found).sum() / weight.sum()) if bool(among.any()) else 0.0

    return share(error.abs() < tolerance, samples.candidate), share(error < -2 * tolerance, samples.lower)
