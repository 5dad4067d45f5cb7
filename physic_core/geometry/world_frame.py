"""Rigid transforms from the camera frame to the world frame, in which y is up."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import Float64Array, FloatArray, Plane


def up_in_camera(floor: Plane | None) -> Float64Array:
    """Return the unit up direction (3,) in the camera frame: the floor's normal, else the camera's
    up axis.
    """
    if floor is None:
        return np.array([0.0, -1.0, 0.0])
    normal = np.asarray(floor.normal, np.float64)
    return normal / np.linalg.norm(normal)


def world_from_camera(floor: Plane | None) -> Float64Array:
    """Return the rigid transform (4, 4), metres, from the camera frame to the world frame (x right,
    y up, z backward, as in glTF).

    With a floor, +y is its normal, the floor is at y = 0, and the camera is above the origin and
    looks along -z. Without one, the camera stays at the origin and y is its up axis.
    """
    up = up_in_camera(floor)
    forward = _project_to_plane(np.array([0.0, 0.0, 1.0]), up)
    if np.linalg.norm(forward) < 0.05:
        # A camera that looks straight down or up: use its y axis instead.
        forward = _project_to_plane(np.array([0.0, np.sign(up[2]), 0.0]), up)
    backward = -forward / np.linalg.norm(forward)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([np.cross(up, backward), up, backward])
    if floor is not None:
        matrix[1, 3] = floor.offset / np.linalg.norm(np.asarray(floor.normal, np.float64))
    return matrix


def transform_points(matrix: Float64Array, points: FloatArray) -> Float64Array:
    """Apply a rigid transform (4, 4) to points (..., 3)."""
    return np.asarray(points, np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def _project_to_plane(axis: Float64Array, up: Float64Array) -> Float64Array:
    return axis - (axis @ up) * up
