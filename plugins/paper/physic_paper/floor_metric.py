"""The paper's floor search: RANSAC in metres on the pixels of a floor mask (Sec. 3.1)."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from physic_core.geometry import FloorSearch, PlaneFit

_TOLERANCE_M = 0.01  # as released; the paper only names RANSAC
_MIN_NORMAL_COSINE = math.cos(math.radians(30.0))  # of an inlier
_HYPOTHESES = 200  # as released
MIN_INLIER_SHARE = 0.0
"""An accepted floor has a larger inlier share."""

_SEED = 0
_SAMPLES = 16_000
_FEWEST_SAMPLES = 40
_REFITS = 8


def fit_floor_metric(
    points: Tensor, normals: Tensor, valid: Tensor, floor_mask: Tensor | None
) -> FloorSearch:
    """Fit a floor plane to the points and normals of a floor mask (paper Sec. 3.1).

    Args:
        points: (H, W, 3) metres.
        normals: (H, W, 3) unit, zero where unreliable.
        valid: (H, W) bool.
        floor_mask: (H, W) bool; None finds no floor, as in the paper.

    Returns:
        The result. Any plane with an inlier is accepted, as in the released code.
    """
    if floor_mask is None:
        return FloorSearch(None, "no_pixels")
    candidate = floor_mask & valid & (normals != 0).any(-1)
    cloud = points[candidate].double()
    directions = normals[candidate].double()
    if len(cloud) < _FEWEST_SAMPLES:
        return FloorSearch(None, "no_pixels")
    plane = _ransac_plane(cloud, directions)
    if plane is None:
        return FloorSearch(None, "no_consensus")
    n, o = plane
    for _ in range(_REFITS):
        inlier = _is_inlier(n, o, cloud, directions)
        if int(inlier.sum()) < 3:
            return FloorSearch(None, "no_consensus")
        n, o = _principal_plane(cloud[inlier])
    if float(o) < 0:
        n = -n
        o = -o
    share = float(_is_inlier(n, o, cloud, directions).double().mean())
    below = float((points[valid].double() @ n + o < -10 * _TOLERANCE_M).double().mean())
    if share <= MIN_INLIER_SHARE:
        return FloorSearch(None, "no_consensus", share, below)
    fit = PlaneFit(n.to(points), float(o), valid, share, below, "floor mask")
    fit = replace(fit, inliers=valid & (fit.height(points).abs() < _TOLERANCE_M))
    return FloorSearch(fit, "found", share, below, in_mask=True)


def _ransac_plane(cloud: Tensor, directions: Tensor) -> tuple[Tensor, Tensor] | None:
    """Return normal (3,) and offset of the plane through three points with the most inliers."""
    generator = torch.Generator().manual_seed(_SEED)
    corner = cloud[torch.randint(len(cloud), (_HYPOTHESES, 3), generator=generator)]
    raw = torch.linalg.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = torch.linalg.vector_norm(raw, dim=-1)
    flat = length > 1e-12
    normal = raw[flat] / length[flat, None]
    offset = -(normal * corner[flat, 0]).sum(-1)
    if not len(normal):
        return None
    some = torch.randperm(len(cloud), generator=generator)[:_SAMPLES]
    batches = zip(normal.split(64), offset.split(64), strict=True)
    votes = torch.cat([_is_inlier(n, o, cloud[some], directions[some]).sum(-1) for n, o in batches])
    best = int(votes.argmax())
    return normal[best], offset[best]


def _is_inlier(normal: Tensor, offset: Tensor, points: Tensor, directions: Tensor) -> Tensor:
    """Return whether points (M, 3) with normals (M, 3) lie on planes (..., 3), (...): (..., M)
    bool.
    """
    near = (normal @ points.T + offset[..., None]).abs() < _TOLERANCE_M
    return near & ((normal @ directions.T).abs() > _MIN_NORMAL_COSINE)


def _principal_plane(cloud: Tensor) -> tuple[Tensor, Tensor]:
    """Fit a plane to points (M, 3) by least squares."""
    centre = cloud.mean(0)
    spread = cloud - centre
    normal = torch.linalg.eigh(spread.T @ spread).eigenvectors[:, 0]
    return normal, -(normal @ centre)
