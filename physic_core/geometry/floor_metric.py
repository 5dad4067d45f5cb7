"""The paper's search for the floor: RANSAC in metres on the pixels that a segmenter calls floor (Sec. 3.1)."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from physic_core.geometry.floor import FloorSearch, PlaneFit
from physic_core.geometry.plane import height

__all__ = ["fit_floor_metric"]

_SAMPLES = 16_000
_FEWEST_SAMPLES = 40
_REFITS = 8


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
