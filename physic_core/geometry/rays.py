"""Ray casts against triangle meshes: by Embree where ``embreex`` is installed, and in NumPy elsewhere.

``embreex`` has no wheel for Linux on ARM. Both find the same triangles, except where a ray passes an edge within the
rounding of Embree's float32. Distances are float64 for both.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from physic_core.geometry.triangle_tree import TriangleTree

__all__ = ["RayCaster", "RayHits", "RayLibrary"]

RayLibrary = Literal["embree", "numpy"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RayHits:
    """First hits of n rays with a mesh.

    Attributes:
        face: (n,) int64, -1 without a hit.
        distance: (n,) float64 in units of the direction's length, inf without a hit; for z = 1 it is the depth.
        corners: (n, 3) float64 barycentric coordinates.
    """

    face: NDArray[np.int64]
    distance: Array
    corners: Array


class RayCaster:
    """Casts rays onto a triangle mesh. Triangles with a coordinate that is not finite are never hit.

    Embree finds the face in float32. The distance to the face's plane is computed in float64, so that large, distant
    faces are as exact as near ones.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3) int.
        library: "embree" or "numpy"; None takes Embree if ``embreex`` is installed.
    """

    def __init__(self, vertices: ArrayLike, faces: ArrayLike, library: RayLibrary | None = None) -> None:
        points, triangles = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
        corners = points[triangles]
        self.low, self.high = points.min(0, initial=np.inf), points.max(0, initial=-np.inf)
        self._corner = corners[:, 0]
        self.normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        """(F, 3), counter-clockwise corners seen from outside, as long as twice the area of the face."""
        self._embree = _embree_scene(points, triangles) if (library or _installed()) == "embree" else None
        self._tree: TriangleTree | None = None
        if self._embree is None:
            from physic_core.geometry.triangle_tree import TriangleTree

            self._tree = TriangleTree(corners)

    def first(self, origins: ArrayLike, directions: ArrayLike) -> RayHits:
        """Return the first hits of rays with origins (n, 3) or (3,) and directions (n, 3) of any length."""
        start, way = _rays(origins, directions)
        if self._tree is not None:
            face, distance, uv = self._tree.first(start, way)
        else:
            found = self._run(start, way, output=True)
            face, uv = found["primID"].astype(np.int64), np.stack([found["u"], found["v"]], 1).astype(np.float64)
            distance = np.where(face >= 0, self._refined(face, found["tfar"], start, way), np.inf)
        u, v = uv.T
        return RayHits(face, distance, np.stack([1 - u - v, u, v], axis=1))

    def first_faces(self, origins: ArrayLike, directions: ArrayLike) -> NDArray[np.int64]:
        """Return the first face on each ray, (n,) int64, -1 without a hit: as :meth:`first`, faster."""
        start, way = _rays(origins, directions)
        if self._tree is not None:
            return self._tree.first(start, way)[0]
        face: NDArray[np.int64] = self._run(start, way).astype(np.int64)
        return face

    def blocked(self, origins: ArrayLike, directions: ArrayLike) -> NDArray[np.bool_]:
        """Return whether each segment from origin to origin + direction hits the mesh, (n,)."""
        start, way = _rays(origins, directions)
        if self._tree is not None:
            near: NDArray[np.bool_] = self._tree.first(start, way)[1] <= 1
            return near
        hit: NDArray[np.bool_] = self._run(start, way, dists=np.ones(len(way), np.float32), query="OCCLUDED") >= 0
        return hit

    def plane_distance(self, faces: NDArray[np.int64], origins: Array, directions: Array) -> Array:
        """Return the distance (n,) of rays to the planes of faces (n,), in units of the direction's length.

        Negative behind the origin, and inf along the plane.
        """
        normal = self.normals[faces]
        slope = _dot(normal, directions)
        height = _dot(normal, self._corner[faces] - origins)
        distance: Array = np.divide(height, slope, out=np.full(len(slope), np.inf), where=slope != 0)
        return distance

    def _run(self, origins: Array, directions: Array, **query: Any) -> Any:
        return self._embree[0].run(origins.astype(np.float32), directions.astype(np.float32), **query)  # type: ignore[index]

    def _refined(self, face: NDArray[np.int64], coarse: NDArray[np.float32], start: Array, way: Array) -> Array:
        """Compute hit distances in float64, except along faces and at tiny faces."""
        # Along a face, and past a tiny one, Embree is more exact than the plane.
        exact = self.plane_distance(face, start, way)
        close: Array = np.where(np.abs(exact - coarse) <= 1e-3 * (1e-2 + np.abs(coarse)), exact, coarse)
        return close


def _rays(origins: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
    way = np.asarray(directions, np.float64)
    return np.broadcast_to(np.asarray(origins, np.float64), way.shape), way


def _dot(a: Array, b: Array) -> Array:
    """Return the dot products (n,) of vectors (n, 3), in an order that is the same on every processor."""
    total: Array = a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]
    return total


@functools.cache
def _installed() -> RayLibrary:
    return "embree" if find_spec("embreex") else "numpy"


@functools.cache
def _device() -> Any:
    """Return the shared Embree device; creating a device takes longer than the ray casts of one body."""
    from embreex.rtcore import EmbreeDevice

    return EmbreeDevice()


def _embree_scene(vertices: Array, faces: NDArray[np.int64]) -> tuple[Any, Any]:
    """Return a scene of Embree and its mesh, which the scene only refers to."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene(_device())
    return scene, TriangleMesh(scene, vertices.astype(np.float32), faces.astype(np.int32))
