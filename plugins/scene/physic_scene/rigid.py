"""Rotations and rigid motions between camera frames, as NumPy arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from physic_core.geometry import nearest_rotation

if TYPE_CHECKING:
    from physic_core.types import FloatArray


@dataclass(frozen=True)
class CameraPose:
    """Pose of a camera: points x of the common frame are ``rotation @ x + translation`` in the
    camera's frame.

    Attributes:
        rotation: (3, 3).
        translation: (3,) metres.
    """

    rotation: FloatArray
    translation: FloatArray

    @classmethod
    def identity(cls) -> CameraPose:
        """Return the pose of the common frame itself."""
        return cls(np.eye(3), np.zeros(3))

    @property
    def centre(self) -> FloatArray:
        """Camera centre (3,) in the common frame."""
        return -self.rotation.T @ self.translation

    def to_camera(self, points: FloatArray) -> FloatArray:
        """Transform points (..., 3) of the common frame to the camera's frame."""
        return points @ self.rotation.T + self.translation

    def to_common(self, points: FloatArray) -> FloatArray:
        """Transform points (..., 3) of the camera's frame to the common frame."""
        return (points - self.translation) @ self.rotation

    def after(self, first: CameraPose) -> CameraPose:
        """Return the pose that applies ``first`` and then this one."""
        return CameraPose(
            self.rotation @ first.rotation, self.rotation @ first.translation + self.translation
        )

    def inverse(self) -> CameraPose:
        """Return the motion from the camera's frame to the common frame."""
        return CameraPose(self.rotation.T, self.centre)


def fit_rotation(source: FloatArray, target: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) with the least weighted squares of ``rotation @ source - target``;
    points (n, 3).
    """
    return nearest_rotation((weight[:, None] * target).T @ source)


def mean_rotation(rotations: FloatArray) -> FloatArray:
    """Return the robust mean (3, 3) of rotations (n, 3, 3): one step of reweighting drops far
    ones.
    """
    turns = Rotation.from_matrix(rotations)
    mean = turns.mean()
    for _ in range(3):
        away = (mean.inv() * turns).magnitude()
        mean = turns.mean(1 / np.maximum(away, np.radians(3)))
    rotation: FloatArray = mean.as_matrix()
    return rotation


def rotation_angle_deg(one: FloatArray, two: FloatArray) -> FloatArray:
    """Return the angles (...) between rotations (..., 3, 3), degrees."""
    trace = np.einsum("...ij,...ij->...", one, two)
    angle: FloatArray = np.degrees(np.arccos(np.clip((trace - 1) / 2, -1, 1)))
    return angle
