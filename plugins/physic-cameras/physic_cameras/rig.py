"""Poses of the cameras of a moment, and points that several of them see."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.types import FloatArray

NEAREST = 1e-3
"""Least depth at which a point is projected."""


@dataclass(frozen=True)
class CameraRig:
    """Poses of V cameras: a point x of the common frame is ``rotation[v] @ x + translation[v]`` in camera v.

    Attributes:
        rotation: (V, 3, 3).
        translation: (V, 3), in metres or in a unit of their own.
    """

    rotation: FloatArray
    translation: FloatArray

    def __len__(self) -> int:
        return len(self.rotation)

    @property
    def centres(self) -> FloatArray:
        """Camera centres (V, 3) in the common frame."""
        centres: FloatArray = -np.einsum("vji,vj->vi", self.rotation, self.translation)
        return centres

    def to_cameras(self, points: FloatArray) -> FloatArray:
        """Transform points (n, 3) of the common frame to the frames of all cameras, (V, n, 3)."""
        local: FloatArray = np.einsum("vij,nj->vni", self.rotation, points) + self.translation[:, None]
        return local

    def relative_to(self, camera: int) -> CameraRig:
        """Return the same cameras in the frame of one of them."""
        turn = self.rotation @ self.rotation[camera].T
        return CameraRig(turn, self.translation - np.einsum("vij,j->vi", turn, self.translation[camera]))

    def scaled(self, factor: float) -> CameraRig:
        """Return the same cameras with all lengths multiplied."""
        return replace(self, translation=factor * self.translation)

    def of(self, cameras: Sequence[int]) -> CameraRig:
        """Return some of the cameras."""
        return CameraRig(self.rotation[list(cameras)], self.translation[list(cameras)])

    def joined(self, camera: int, rotation: FloatArray, translation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the pose in the common frame of a camera whose pose in the frame of one of these is known."""
        return rotation @ self.rotation[camera], rotation @ self.translation[camera] + translation


def known_motion(one: FloatArray, two: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rotation (3, 3) and translation (3,) from one camera to another, of their poses (4, 4) in a rig."""
    motion = np.linalg.inv(two) @ one
    return motion[:3, :3], motion[:3, 3]


def triangulate(rays: FloatArray, weight: FloatArray, rig: CameraRig) -> FloatArray:
    """Return the points (n, 3) that cameras see: least squares of the errors of their rays.

    Args:
        rays: (V, n, 2) x / z and y / z in each camera.
        weight: (V, n), 0 where a camera does not see the point.
        rig: the V cameras.

    Returns:
        Points in the frame of the rig, NaN where fewer than two cameras see them.
    """
    rows = rig.rotation[:, None, :2] - rays[..., None] * rig.rotation[:, None, 2:]  # (V, n, 2, 3)
    target = rays * rig.translation[:, None, 2:] - rig.translation[:, None, :2]
    depth = np.ones(weight.shape)
    enough = (weight > 0).sum(0) > 1
    points = np.full((rays.shape[1], 3), np.nan)
    for _ in range(3):  # errors of rays are those of these rows divided by the depth
        share = ((weight / depth) ** 2)[:, enough, None]
        normal = np.einsum("vnk,vnki,vnkj->nij", share, rows[:, enough], rows[:, enough])
        right = np.einsum("vnk,vnki,vnk->ni", share, rows[:, enough], target[:, enough])
        points[enough] = np.einsum("nij,nj->ni", np.linalg.pinv(normal, hermitian=True), right)
        depth = np.maximum(np.abs(rig.to_cameras(np.nan_to_num(points))[..., 2]), NEAREST)
    return points
