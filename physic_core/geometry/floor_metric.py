"""The paper's search for the floor: RANSAC in metres on the pixels that a segmenter calls floor (Sec. 3.1)."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from physic_core.geometry.floor import FloorSearch, PlaneFit
from physic_core.geometry.plane import height

__all__ = ["LEAST_SHARE", "fit_floor_metric"]

# As released; only "RANSAC" is printed.
_TOLERANCE_M = 0.01
_ALIGNED = math.cos(math.radians(30.0))  # of an inlier's normal with the plane's
_HYPOTHESES = 200
LEAST_SHARE = 0.0
"""Share of the mask's points that must lie on a plane, and more."""

_SEED = 0
_SAMPLES = 16_000
_FEWEST_SAMPLES = 40
_REFITS = 8


def fit_floor_metric(points: Tensor, normals: Tensor, valid: Tensor, floor_mask: Tensor | None) -> FloorSearch:
    """Find the floor among the points of a floor mask, by positions and normals (paper Sec. 3.1).

    Args:
        points: (H, W, 3) metres.
        normals: (H, W, 3) unit, zero where unreliable.
        valid: (H, W) bool.
        floor_mask: (H, W) bool; without one there is no floor, as in the paper.

    Returns:
        The result. Every plane that a point agrees with is accepted, as in the released code.
    """
    if floor_mask is None:
        return FloorSearch(None, "no_pixels")
    candidate = floor_mask & valid & (normals != 0).any(-1)
    cloud, directions = points[candidate].double(), normals[candidate].double()
    if len(cloud) < _FEWEST_SAMPLES:
        return FloorSearch(None, "no_pixels")
    plane = _ransac(cloud, directions)
    if plane is None:
        return FloorSearch(None, "no_consensus")
    n, o = plane
    for _ in range(_REFITS):
        inlier = _on_plane(n, o, cloud, directions)
        if int(inlier.sum()) < 3:
            return FloorSearch(None, "no_consensus")
        n, o = _principal_plane(cloud[inlier])
    if float(o) < 0:
        n, o = -n, -o
    share = float(_on_plane(n, o, cloud, directions).double().mean())
    below = float((height(points[valid].double(), n, o) < -10 * _TOLERANCE_M).double().mean())
    if share <= LEAST_SHARE:
        return FloorSearch(None, "no_consensus", share, below)
    inliers = valid & (height(points, n, float(o)).abs() < _TOLERANCE_M)
    fit = PlaneFit(n.to(points), float(o), inliers, share, below, "floor mask")
    return FloorSearch(fit, "found", share, below)


def _ransac(cloud: Tensor, directions: Tensor) -> tuple[Tensor, Tensor] | None:
    """Normal (3,) and offset of the plane through three points that most of some points (M, 3) agree with."""
    generator = torch.Generator().manual_seed(_SEED)
    corner = cloud[torch.randint(len(cloud), (_HYPOTHESES, 3), generator=generator).to(cloud.device)]
    raw = torch.linalg.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = torch.linalg.vector_norm(raw, dim=-1)
    flat = length > 1e-12
    normal = raw[flat] / length[flat, None]
    offset = -(normal * corner[flat, 0]).sum(-1)
    if not len(normal):
        return None
    some = torch.randperm(len(cloud), generator=generator)[:_SAMPLES].to(cloud.device)
    batches = zip(normal.split(64), offset.split(64), strict=True)
    votes = torch.cat([_on_plane(n, o, cloud[some], directions[some]).sum(-1) for n, o in batches])
    best = int(votes.argmax())
    return normal[best], offset[best]


def _on_plane(normal: Tensor, offset: Tensor, points: Tensor, directions: Tensor) -> Tensor:
    """Planes (..., 3) and (...), points (M, 3) with normals (M, 3) -> (..., M) bool."""
    near = (normal @ points.T + offset[..., None]).abs() < _TOLERANCE_M
    return near & ((normal @ directions.T).abs() > _ALIGNED)


def _principal_plane(cloud: Tensor) -> tuple[Tensor, Tensor]:
    """The plane of smallest squared distance to (M, 3) points."""
    centre = cloud.mean(0)
    spread = cloud - centre
    normal = torch.linalg.eigh(spread.T @ spread).eigenvectors[:, 0]
    return normal, -(normal @ centre)
