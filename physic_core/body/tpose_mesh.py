"""Mesh of the mean body in its T-pose, for finding parts, contact sets and landmarks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["TPoseMesh", "vertex_normals"]


@dataclass(frozen=True)
class TPoseMesh:
    """Mesh, joints and skinning weights of a body in the T-pose: y up, +z forward, left on +x, metres.

    Attributes:
        vertices: (V, 3).
        faces: (F, 3) int.
        joints: (55, 3) in SMPL-X order.
        weights: (V, 55) skinning weights.
        outer: (V,) bool, False for cavities.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    joints: NDArray[np.float64]
    weights: NDArray[np.float64]
    outer: NDArray[np.bool_]

    @property
    def normals(self) -> NDArray[np.float64]:
        """(V, 3) unit outward normals."""
        return vertex_normals(self.vertices, self.faces)


def vertex_normals(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return area-weighted unit normals (V, 3); zero at vertices without a face."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    face_normals = np.cross(b - a, c - a)
    total = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(total, faces[:, k], face_normals)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    unit: NDArray[np.float64] = np.divide(total, length, out=np.zeros_like(total), where=length > 0)
    return unit
