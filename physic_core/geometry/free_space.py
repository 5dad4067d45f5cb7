"""Test whether points lie in front of all surfaces of a depth map, and move points behind bodies along their rays.

Camera frame, metres.

Beyond the rim of a surface, the normal of the nearest scene point does not tell inside from outside. For example, a
calf in front of a seat is below the seat's plane, but not inside the seat.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from physic_core.geometry.rays import RayCaster


def front_depth(depth: Tensor) -> Tensor:
    """Return the least depth of each 2 x 2 pixel block: (H, W) -> (H - 1, W - 1); inf if none is finite.

    Four pixels, since at a depth edge a single one may show the background.
    """
    known = torch.where(torch.isfinite(depth), depth, torch.full_like(depth, torch.inf))
    rows = torch.minimum(known[:-1], known[1:])
    return torch.minimum(rows[:, :-1], rows[:, 1:])


def in_free_space(points: Tensor, front: Tensor, K: Tensor) -> Tensor:
    """Return whether each point (..., 3) lies in front of every surface of the depth map: (...) bool.

    Args:
        points: camera frame, in the unit of ``front``.
        front: (H - 1, W - 1), from :func:`front_depth`.
        K: (3, 3) px of the full image. Points outside the image or behind the camera are in free space.
    """
    K, z = K.to(points), points[..., 2]
    ahead = z > 1e-6
    away = torch.where(ahead, z, torch.ones_like(z))
    column = (K[0, 0] * points[..., 0] / away + K[0, 2]).floor()
    row = (K[1, 1] * points[..., 1] / away + K[1, 2]).floor()
    height, width = front.shape
    inside = ahead & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    flat = torch.where(inside, row * width + column, torch.zeros_like(row)).long()
    return ~(inside & (front.flatten()[flat] < z))


_Array = NDArray[np.float64]

_ROUNDS = 3  # a point that leaves one limb may enter another
_STEP_M = 1e-4  # beyond a face, so that the next ray does not hit it again


def move_behind_bodies(
    points: Tensor, bodies: Tensor, faces: Tensor, shown: Tensor, reach: float
) -> tuple[Tensor, Tensor]:
    """Move scene points (N, 3) out of bodies, and behind bodies that are visible at their pixels.

    A point that would move farther than ``reach`` does not move: then body or scene is wrong.

    Args:
        points: (N, 3).
        bodies: (B, V, 3), finite.
        faces: (F, 3) int64, of a closed surface, counter-clockwise seen from outside.
        shown: (B, N) bool, whether the body is visible at the point's pixel.
        reach: metres.

    Returns:
        points: (N, 3), moved.
        moved: (N,) bool.
    """
    start: _Array = points.detach().cpu().double().numpy()
    rays = start / np.maximum(np.linalg.norm(start, axis=1), 1e-9)[:, None]
    along = np.zeros(len(start))
    if not len(start):
        return points, torch.zeros(0, dtype=torch.bool, device=points.device)
    triangles = faces.cpu().numpy()
    casters = [RayCaster(body, triangles) for body in bodies.detach().cpu().double().numpy()]
    for caster, here in zip(casters, shown.cpu().numpy(), strict=True):
        along[here] = np.maximum(along[here], _distance_to_front(caster, start[here], rays[here], reach))
    for _ in range(_ROUNDS):
        before = along.copy()
        for caster in casters:
            along = along + _distance_to_exit(caster, start + along[:, None] * rays, rays)
        if np.array_equal(along, before):
            break
    along = np.where(along <= reach, along, 0.0)
    moved = torch.from_numpy(start + along[:, None] * rays).to(points)
    out = torch.from_numpy(along > 0).to(points.device)
    return torch.where(out[:, None], moved, points), out


def _distance_to_front(caster: RayCaster, points: _Array, rays: _Array, reach: float) -> _Array:
    """Return the distance from each point to the front face behind it on its ray; 0 for others."""
    face = caster.first_faces(np.zeros(3), rays)
    front = (face >= 0) & ((caster.normals[face] * rays).sum(1) < 0)
    way = caster.plane_distance(face, np.zeros_like(rays), rays) - np.linalg.norm(points, axis=1)
    return np.where(front & (way > 0) & (way <= reach), way + _STEP_M, 0.0)


def _distance_to_exit(caster: RayCaster, points: _Array, rays: _Array) -> _Array:
    """Return the distance from each inside point along its ray to the surface; 0 for outside points."""
    way = np.zeros(len(points))
    near = np.flatnonzero(((points > caster.low) & (points < caster.high)).all(1))
    face = caster.first_faces(points[near], rays[near])
    near, face = near[face >= 0], face[face >= 0]
    distance = caster.plane_distance(face, points[near], rays[near])
    from_within = ((caster.normals[face] * rays[near]).sum(1) > 0) & (distance > 0)
    way[near[from_within]] = distance[from_within] + _STEP_M
    return way
