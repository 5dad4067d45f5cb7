"""Planes ``n @ X + o = 0``: sample points, and the up direction that surface normals show.

The height ``n @ X + o`` is positive above the plane, and o is the height of the camera. OpenCV
camera frame.

Most man-made surfaces are horizontal or vertical: normals are parallel or perpendicular to up
(Gupta, Arbelaez and Malik, CVPR 2013, sec. 3).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

_SPACING_M = 0.025  # between points near people
_NEAR_M = 1.5  # distance from a person up to which points are near
_MAX_POINTS = 40_000


def plane_basis(normal: Tensor) -> tuple[Tensor, Tensor]:
    """Return two unit vectors (3,) that span the plane; their cross product is the normal."""
    side = normal.new_tensor([1.0, 0.0, 0.0])
    if abs(float(normal[0])) > 0.9:
        side = normal.new_tensor([0.0, 0.0, 1.0])
    first = side - (side @ normal) * normal
    first = first / torch.linalg.vector_norm(first)
    return first, torch.linalg.cross(normal, first)


def sample_plane(normal: Tensor, offset: float, points: Tensor, centres: Tensor) -> Tensor:
    """Sample points on a plane over the extent of a scene.

    The extent is the 2nd to 98th percentile of the scene along both axes of the plane. Points are
    2.5 cm apart within 1.5 m of the centres, and elsewhere as dense as 40,000 points in all allow.

    Args:
        normal: (3,) unit.
        offset: of the plane.
        points: (M, 3) of the scene, metres.
        centres: (P, 3) positions of people; the nearest scene point if empty.

    Returns:
        (N, 3) metres; N = 0 for an empty scene.
    """
    if not len(points):
        return points.new_zeros((0, 3))
    axes = torch.stack(plane_basis(normal))
    origin = -offset * normal
    flat = (points[:: max(1, len(points) // 100_000)] - origin) @ axes.T
    # torch.quantile does not support large inputs
    low, high = (
        flat.kthvalue(1 + round(share * (len(flat) - 1)), dim=0).values for share in (0.02, 0.98)
    )
    if not len(centres):
        centres = points[torch.linalg.vector_norm(points, dim=-1).argmin()][None]
    middles = (centres - origin) @ axes.T
    # At most half of the points are near the centres.
    fine = max(_SPACING_M, math.sqrt(2 * math.pi * _NEAR_M**2 / _MAX_POINTS))
    close = _disc_points(middles, _NEAR_M, fine)
    while len(close) > max(_MAX_POINTS // 2, len(middles)):
        fine *= math.sqrt(2 * len(close) / _MAX_POINTS) * 1.01
        close = _disc_points(middles, _NEAR_M, fine)
    wide = _grid_points(low, high, fine, _MAX_POINTS - len(close)).to(flat)
    wide = wide[(torch.cdist(wide, middles) > _NEAR_M).all(-1)]
    return origin + torch.cat((close, wide)) @ axes


def _grid_points(low: Tensor, high: Tensor, spacing: float, max_points: int) -> Tensor:
    """Return points (n, 2) of a rectangle, at least a spacing apart, and at most so many."""
    area = float((high - low).clamp(min=1e-6).prod())
    spacing = max(spacing, math.sqrt(area / max_points))
    counts = ((high - low) / spacing).floor().clamp(min=0).long() + 1
    while int(counts.prod()) > max_points:
        spacing *= 1.02
        counts = ((high - low) / spacing).floor().clamp(min=0).long() + 1
    lines = [
        float(low[i]) + spacing * torch.arange(int(counts[i]), dtype=low.dtype) for i in (0, 1)
    ]
    return torch.cartesian_prod(*lines)


def _disc_points(middles: Tensor, radius: float, spacing: float) -> Tensor:
    """Return the points (N, 2) of a square lattice within ``radius`` of any centre (P, 2)."""
    reach = math.ceil(radius / spacing) + 1
    step = torch.arange(-reach, reach + 1)
    around = torch.cartesian_prod(step, step)
    cells = []
    for middle in middles:
        cell = (middle / spacing).round().long() + around
        cells.append(cell[torch.linalg.vector_norm(cell * spacing - middle, dim=-1) <= radius])
    points = torch.cat(cells)
    if not len(points):
        return points.to(middles)
    # One number per cell: torch.unique of rows is 40 times slower. 64 bits hold a lattice of 3e9
    # rows and columns.
    low = points.amin(0)
    rows, columns = (points - low).unbind(-1)
    width = int(columns.max()) + 1
    once = torch.unique(rows * width + columns)
    return (torch.stack((once // width, once % width), -1) + low).to(middles) * spacing


class UpEstimate(NamedTuple):
    """Up direction with its confidence.

    Attributes:
        up: (3,) unit, float64, camera frame.
        confidence: gap between the two smallest eigenvalues of the fit, per normal, 0-1.
    """

    up: Tensor
    confidence: float


_SAMPLES = 20_000


def sample_normals(normals: Tensor, where: Tensor | None = None) -> Tensor:
    """Return some 20,000 (n, 3) of the known normals among (..., 3), in float64; a sample of the
    sample is itself.

    Args:
        normals: unit, zero where unknown.
        where: (...) bool, those to choose from; all if None.
    """
    is_unit = normals.square() @ normals.new_ones(3) > 0.5
    rows = (is_unit if where is None else is_unit & where).flatten().nonzero()[:, 0]
    chosen = rows[:: max(1, len(rows) // _SAMPLES)]
    return normals.flatten(0, -2).index_select(0, chosen).double()


_ROUNDS = ((45.0, 5), (20.0, 5), (10.0, 5))  # largest deviation in degrees, number of iterations
_FEWEST = 200


def estimate_up(normals: Tensor, start: Tensor | None = None) -> UpEstimate | None:
    """Estimate the up direction from unit surface normals (M, 3), camera frame, zero where unknown.

    The search starts at ``start`` (3,) unit, or at the camera's own up axis; either may be wrong by
    45 degrees, which a camera that looks down steeply exceeds. None if there are too few normals.
    """
    sample = sample_normals(normals)
    if len(sample) < _FEWEST:
        return None
    up = sample.new_tensor([0.0, -1.0, 0.0]) if start is None else start.to(sample)
    values = sample.new_ones(3)
    for degrees, times in _ROUNDS:
        reach = math.radians(degrees)
        for _ in range(times):
            cosine = (sample @ up).abs()
            level = cosine > math.cos(reach)
            upright = cosine < math.sin(reach)
            spread = sample[upright].T @ sample[upright] - sample[level].T @ sample[level]
            values, directions = torch.linalg.eigh(spread)
            up = -directions[:, 0] if float(directions[:, 0] @ up) < 0 else directions[:, 0]
    return UpEstimate(up, float(values[1] - values[0]) / len(sample))
