"""Move inpainted scene points behind the bodies that they intersect or occlude.

Camera frame, metres. Points move along their rays.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from physic_core.geometry.visibility import embree_device

__all__ = ["move_behind_bodies"]

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
    start: NDArray[np.float64] = points.detach().cpu().double().numpy()
    rays = start / np.maximum(np.linalg.norm(start, axis=1), 1e-9)[:, None]
    along = np.zeros(len(start))
    if not len(start):
        return points, torch.zeros(0, dtype=torch.bool, device=points.device)
    triangles = faces.cpu().numpy()
    casters = [_BodyRays(body, triangles) for body in bodies.detach().cpu().double().numpy()]
    for caster, here in zip(casters, shown.cpu().numpy(), strict=True):
        along[here] = np.maximum(along[here], caster.distance_to_front(start[here], rays[here], reach))
    for _ in range(_ROUNDS):
        before = along.copy()
        for caster in casters:
            along = along + caster.distance_to_exit(start + along[:, None] * rays, rays)
        if np.array_equal(along, before):
            break
    along = np.where(along <= reach, along, 0.0)
    moved = torch.from_numpy(start + along[:, None] * rays).to(points)
    out = torch.from_numpy(along > 0).to(points.device)
    return torch.where(out[:, None], moved, points), out


class _BodyRays:
    """Ray casts against the surface of one body."""

    def __init__(self, body: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._low, self._high = body.min(0), body.max(0)
        self._corner, second, third = (body[faces[:, k]] for k in range(3))
        self._normal = np.cross(second - self._corner, third - self._corner)
        self._scene = EmbreeScene(embree_device())
        TriangleMesh(self._scene, body.astype(np.float32), faces.astype(np.int32))

    def distance_to_front(
        self, points: NDArray[np.float64], rays: NDArray[np.float64], reach: float
    ) -> NDArray[np.float64]:
        """Return the distance from each point to the front face behind it on its ray; 0 for others."""
        face = self._scene.run(np.zeros_like(points, np.float32), rays.astype(np.float32))
        hit = face >= 0
        normal = self._normal[face]
        slope = (normal * rays).sum(1)
        front = (normal * self._corner[face]).sum(1) / np.where(hit & (slope < 0), slope, np.inf)
        way = front - np.linalg.norm(points, axis=1)
        return np.where((way > 0) & (way <= reach), way + _STEP_M, 0.0)

    def distance_to_exit(self, points: NDArray[np.float64], rays: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance from each inside point along its ray to the surface; 0 for outside points."""
        way = np.zeros(len(points))
        near = np.flatnonzero(((points > self._low) & (points < self._high)).all(1))
        if not len(near):
            return way
        face = self._scene.run(points[near].astype(np.float32), rays[near].astype(np.float32))
        near, face = near[face >= 0], face[face >= 0]
        normal = self._normal[face]
        slope = (normal * rays[near]).sum(1)
        # In float64, on the plane of the face: embree's own distances are float32.
        ahead = (normal * (self._corner[face] - points[near])).sum(1)
        distance = ahead / np.where(np.abs(slope) > 1e-15, slope, np.inf)
        from_within = (slope > 0) & (distance > 0)
        way[near[from_within]] = distance[from_within] + _STEP_M
        return way
