"""The released code's point map normals, outlier removal by normals, and floor samples."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor

from physic_paper.outliers import nearest_other_points

_LEAST_CROSS = 1e-6  # square metres; below, no normal


def published_normals(points: Tensor, valid: Tensor) -> Tensor:
    """Return normals towards the camera: means of the unit cross products of differences to
    adjacent neighbours.

    Args:
        points: (H, W, 3) metres.
        valid: (H, W) bool; invalid points count as the origin, as released.

    Returns:
        (H, W, 3) unit, zero where unknown.
    """
    kind = points.dtype
    # Nearly parallel differences leave few digits of float32, and which ones depends on the
    # processor's kernels.
    points = torch.where(valid[..., None], points, 0.0).double()
    down = points.diff(dim=0)
    right = points.diff(dim=1)
    above = F.pad(-down, (0, 0, 0, 0, 1, 0))
    below = F.pad(down, (0, 0, 0, 0, 0, 1))
    before = F.pad(-right, (0, 0, 1, 0))
    after = F.pad(right, (0, 0, 0, 1))
    total = torch.zeros_like(points)
    for one, other in ((above, before), (before, below), (below, after), (after, above)):
        cross = torch.linalg.cross(one, other)
        length = torch.linalg.vector_norm(cross, dim=-1, keepdim=True)
        unit = torch.where(length > _LEAST_CROSS, cross / length.clamp(min=_LEAST_CROSS), 0.0)
        total = total - unit * torch.sign((unit * points).sum(-1, keepdim=True))
    return (F.normalize(total, dim=-1) * valid[..., None]).to(kind)


_MAX_ANGLE_DEG = 50.0  # of an inlier's normal to the mean of its neighbours


def published_normal_outliers(points: Tensor, normals: Tensor, neighbors: int) -> Tensor:
    """Return points whose normal is zero or differs from the mean normal of their neighbours: (M,)
    bool.

    Args:
        points: (M, 3), finite.
        normals: (M, 3) unit or zero.
        neighbors: k, the point itself not counted.
    """
    if min(neighbors, len(points) - 1) < 1:
        return torch.zeros(len(points), dtype=torch.bool)
    _, index = nearest_other_points(points, neighbors)
    mean = torch.zeros_like(normals)
    for column in index.T:
        mean = mean + normals[column]
    alike = (normals * F.normalize(mean, dim=-1)).sum(-1)
    return alike < math.cos(math.radians(_MAX_ANGLE_DEG))


def published_floor_grid(normal: Tensor, offset: float, points: Tensor, count: int) -> Tensor:
    """Sample a grid on a floor plane, from the 2nd to the 98th percentile of the scene in x and z;
    z varies fastest.

    Args:
        normal: (3,) unit, not horizontal.
        offset: of the plane.
        points: (M, 3) of the scene, metres.
        count: points along each axis.

    Returns:
        (count * count, 3) metres; none for an empty scene or a vertical plane.
    """
    if not len(points) or float(normal[1].abs()) < 1e-3:
        return points.new_zeros((0, 3))
    lines = []
    for axis in (0, 2):
        ordered = points[:, axis].sort().values
        low, high = (float(ordered[int(share * len(ordered))]) for share in (0.02, 0.98))
        lines.append(torch.linspace(low, high, count, dtype=torch.float64))
    x, z = torch.cartesian_prod(*lines).unbind(-1)
    a, b, c = normal.double().tolist()
    return torch.stack([x, -(a * x + c * z + offset) / b, z], -1).to(points)
