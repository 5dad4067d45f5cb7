"""Mesh of the mean body in its T-pose, for finding parts, contact sets and landmarks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physic_core.geometry.mesh import vertex_normals

__all__ = ["TPoseMesh"]


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
