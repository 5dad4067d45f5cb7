"""Ray casts against triangle meshes (embree)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_testing.worlds.reproducible_math import dot

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray

__all__ = ["RayCaster", "RayHits"]


@dataclass(frozen=True)
class RayHits:
    """First hits of n rays with a mesh.

    Attributes:
        face: (n,) int64, -1 without a hit.
        distance: (n,) float64 in units of the direction's length, inf without a hit; for z = 1 it is the depth.
        corners: (n, 3) float64 barycentric coordinates.
    """

    face: NDArray[np.int64]
    distance: FloatArray
    corners: FloatArray


class RayCaster:
    """Ray caster of a triangle mesh.

    Embree finds the face in float32. The distance to the face's plane is computed in float64, so that large, distant
    faces are as exact as near ones.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3) int.
    """

    def __init__(self, vertices: FloatArray, faces: NDArray[Any]) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        corners = np.asarray(vertices, np.float64)[np.asarray(faces)]
        self._corner = corners[:, 0]
        self._normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._scene = EmbreeScene()
        self._mesh = TriangleMesh(
            self._scene, vertices=np.asarray(vertices, np.float32), indices=np.asarray(faces, np.int32)
        )

    def first(self, origins: FloatArray, directions: FloatArray) -> RayHits:
        """Return the first hits of rays with origins (n, 3) or (3,) and directions (n, 3) of any length."""
        start, along = self._rays(origins, directions)
        found = self._scene.run(start, along, output=True)
        face = found["primID"].astype(np.int64)
        u, v = found["u"].astype(np.float64), found["v"].astype(np.float64)
        return RayHits(
            face=face,
            distance=np.where(face >= 0, self._refined(face, found["tfar"], origins, directions), np.inf),
            corners=np.stack([1 - u - v, u, v], axis=1),
        )

    def blocked(self, origins: FloatArray, directions: FloatArray) -> BoolArray:
        """Return whether each segment from origin to origin + direction hits the mesh."""
        start, along = self._rays(origins, directions)
        hit: BoolArray = self._scene.run(start, along, dists=np.ones(len(along), np.float32), query="OCCLUDED") >= 0
        return hit

    def _refined(
        self, face: NDArray[np.int64], coarse: NDArray[np.float32], origins: FloatArray, directions: FloatArray
    ) -> FloatArray:
        """Compute hit distances in float64, except along faces and at tiny faces."""
        normal, corner = self._normal[face], self._corner[face]
        slope = dot(normal, directions)
        height = dot(normal, corner - origins)
        # Along a face, and past a tiny one, the plane tells less than embree does.
        exact = np.divide(height, slope, out=np.full(len(slope), np.inf), where=slope != 0)
        close: FloatArray = np.where(np.abs(exact - coarse) <= 1e-3 * (1e-2 + np.abs(coarse)), exact, coarse)
        return close

    @staticmethod
    def _rays(origins: FloatArray, directions: FloatArray) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return origins and directions as contiguous float32 arrays."""
        along = np.ascontiguousarray(directions, np.float32)
        return np.ascontiguousarray(np.broadcast_to(origins, along.shape), np.float32), along
