"""From the camera's frame to one that stands upright in a viewer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Plane

    Matrix = NDArray[np.float64]

__all__ = ["gltf_from_camera", "transform", "up_in_camera"]


def up_in_camera(floor: Plane | None) -> Matrix:
    """(3,) unit vector that points up, camera frame: the floor's normal, else the camera's own up."""
    if floor is None:
        return np.array([0.0, -1.0, 0.0])
    normal = np.asarray(floor.normal, np.float64)
    return normal / np.linalg.norm(normal)


def gltf_from_camera(floor: Plane | None) -> Matrix:
    """(4, 4) rigid transform, metres: camera frame (x right, y down, z forward) -> glTF's (x right, y up, z backward).

    With a floor, +y is its normal, the floor lies at y = 0 and the camera over the origin, looking along -z. Without
    one, the camera stays at the origin and y is its own up.
    """
    up = up_in_camera(floor)
    forward = _level(np.array([0.0, 0.0, 1.0]), up)
    if np.linalg.norm(forward) < 0.05:
        # Looking straight down or up leaves no forward on the floor: the picture's upper or lower edge leads the way.
        forward = _level(np.array([0.0, np.sign(up[2]), 0.0]), up)
    backward = -forward / np.linalg.norm(forward)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([np.cross(up, backward), up, backward])
    if floor is not None:
        matrix[1, 3] = floor.offset / np.linalg.norm(np.asarray(floor.normal, np.float64))
    return matrix


def transform(matrix: Matrix, points: NDArray[np.floating[Any]]) -> Matrix:
    """Rigid transform (4, 4) of points (..., 3)."""
    return np.asarray(points, np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def _level(axis: Matrix, up: Matrix) -> Matrix:
    return axis - (axis @ up) * up
