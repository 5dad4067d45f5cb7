"""Inpainted surfaces give way to the bodies that hid them.

Points inside a body move behind it, along their rays, and so do points before a body where the photo shows it.

Metres, camera frame.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from physic_core.geometry.visibility import embree_device

__all__ = ["carved"]

_ROUNDS = 3  # limbs that touch: out of one may be into the next
_STEP_M = 1e-4  # beyond a face, so that the next ray does not meet it again


def carved(points: Tensor, bodies: Tensor, faces: Tensor, shown: Tensor, reach: float) -> tuple[Tensor, Tensor]:
    """Points (N, 3) outside all bodies, and which of them moved (N,) bool.

    A ray from an inside point, away from the camera, meets the surface from within. Points that would have to move
    farther than ``reach`` stay: there body or scene is wrong, and a hole would hide it.

    Args:
        points: (N, 3).
        bodies: (B, V, 3), finite.
        faces: (F, 3) int64, of a closed surface, counter-clockwise seen from outside.
        shown: (B, N) bool, the photo shows this body at the point's pixel.
        reach: metres.
    """
    start: NDArray[np.float64] = points.detach().cpu().double().numpy()
    rays = start / np.maximum(np.linalg.norm(start, axis=1), 1e-9)[:, None]
    along = np.zeros(len(start))
    if not len(start):
        return points, torch.zeros(0, dtype=torch.bool, device=points.device)
    triangles = faces.cpu().numpy()
    solids = [_Solid(body, triangles) for body in bodies.detach().cpu().double().numpy()]
    for solid, here in zip(solids, shown.cpu().numpy(), strict=True):
        along[here] = np.maximum(along[here], solid.way_in(start[here], rays[here], reach))
    for _ in range(_ROUNDS):
        before = along.copy()
        for solid in solids:
            along = along + solid.way_out(start + along[:, None] * rays, rays)
        if np.array_equal(along, before):
            break
    along = np.where(along <= reach, along, 0.0)
    moved = torch.from_numpy(start + along[:, None] * rays).to(points)
    out = torch.from_numpy(along > 0).to(points.device)
    return torch.where(out[:, None], moved, points), out


class _Solid:
    """A body that rays can be cast at from within."""

    def __init__(self, body: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._low, self._high = body.min(0), body.max(0)
        self._corner, second, third = (body[faces[:, k]] for k in range(3))
        self._normal = np.cross(second - self._corner, third - self._corner)
        self._scene = EmbreeScene(embree_device())
        TriangleMesh(self._scene, body.astype(np.float32), faces.astype(np.int32))

    def way_in(self, points: NDArray[np.float64], rays: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
        """How far along its ray each point is before the front that the camera sees, and a little more; 0 behind it."""
        face = self._scene.run(np.zeros_like(points, np.float32), rays.astype(np.float32))
        hit = face >= 0
        normal = self._normal[face]
        slope = (normal * rays).sum(1)
        front = (normal * self._corner[face]).sum(1) / np.where(hit & (slope < 0), slope, np.inf)
        way = front - np.linalg.norm(points, axis=1)
        return np.where((way > 0) & (way <= reach), way + _STEP_M, 0.0)

    def way_out(self, points: NDArray[np.float64], rays: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far along its ray each point is inside; 0 outside."""
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
