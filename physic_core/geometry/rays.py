"""Ray casts against triangle meshes: by Embree where ``embreex`` is installed, and in NumPy
elsewhere.

``embreex`` has no wheel for Linux on ARM. Both find the same triangles, except where a ray passes
an edge within the rounding of Embree's float32. Distances are float64 for both.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

if TYPE_CHECKING:
    from physic_core.types import Float32Array, Float64Array, Int64Array


RayLibrary = Literal["embree", "numpy"]


_FAN = 4  # children of a box
_BLOCK = 1 << 14  # rays walked together, which bounds the memory
_MARGIN = 1e-9  # of all triangles' extent and of a triangle's sides: no ray passes between two


@dataclass(frozen=True)
class RayHits:
    """First hits of n rays with a mesh.

    Attributes:
        face: (n,) int64, -1 without a hit.
        distance: (n,) float64 in units of the direction's length, inf without a hit; for z = 1 it
            is the depth.
        barycentric: (n, 3) float64, coordinates in the triangle.
    """

    face: Int64Array
    distance: Float64Array
    barycentric: Float64Array


class RayCaster:
    """Casts rays onto a triangle mesh.

    Triangles with a coordinate that is not finite are never hit.

    Embree finds the face in float32. The distance to the face's plane is computed in float64, so
    that large, distant faces are as exact as near ones.

    Attributes:
        vertices: (V, 3) float64 metres.
        faces: (F, 3) int64.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3) int.
        library: "embree" or "numpy"; None takes Embree if ``embreex`` is installed.
    """

    def __init__(
        self, vertices: ArrayLike, faces: ArrayLike, library: RayLibrary | None = None
    ) -> None:
        self.vertices = np.asarray(vertices, np.float64)
        self.faces = np.asarray(faces, np.int64)
        corners = self.vertices[self.faces]
        self.low = self.vertices.min(0, initial=np.inf)
        self.high = self.vertices.max(0, initial=-np.inf)
        self._corner = corners[:, 0]
        self.normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        """(F, 3), counter-clockwise corners seen from outside, as long as twice the area of the
        face.
        """
        self._tree: _TriangleTree | None = None
        if (library or _installed()) == "embree":
            self._embree = _embree_scene(self.vertices, self.faces)
        else:
            self._tree = _TriangleTree(corners)

    def first(self, origins: ArrayLike, directions: ArrayLike) -> RayHits:
        """Return the first hits of rays with origins (n, 3) or (3,) and directions (n, 3) of any
        length.
        """
        start, direction = _as_rays(origins, directions)
        if self._tree is not None:
            face, distance, uv = self._tree.first(start, direction)
        else:
            hits = self._run(start, direction, output=True)
            face = hits["primID"].astype(np.int64)
            uv = np.stack([hits["u"], hits["v"]], 1).astype(np.float64)
            hit = np.flatnonzero(face >= 0)
            distance = np.full(len(face), np.inf)
            distance[hit] = self._refine_distances(
                face[hit], hits["tfar"][hit], start[hit], direction[hit]
            )
        u, v = uv.T
        return RayHits(face, distance, np.stack([1 - u - v, u, v], axis=1))

    def first_faces(self, origins: ArrayLike, directions: ArrayLike) -> Int64Array:
        """Return the first face on each ray, (n,) int64, -1 without a hit: as :meth:`first`,
        faster.
        """
        start, direction = _as_rays(origins, directions)
        if self._tree is not None:
            return self._tree.first(start, direction)[0]
        face: Int64Array = self._run(start, direction).astype(np.int64)
        return face

    def plane_distance(
        self, faces: Int64Array, origins: Float64Array, directions: Float64Array
    ) -> Float64Array:
        """Return the distance (n,) of rays to the planes of faces (n,), in units of the direction's
        length.

        Negative behind the origin, and inf along the plane.
        """
        normal = self.normals[faces]
        slope = _dot(normal.T, directions.T)
        height = _dot(normal.T, (self._corner[faces] - origins).T)
        distance: Float64Array = np.divide(
            height, slope, out=np.full(len(slope), np.inf), where=slope != 0
        )
        return distance

    def _run(self, origins: Float64Array, directions: Float64Array, **query: Any) -> Any:
        return self._embree[0].run(
            origins.astype(np.float32), directions.astype(np.float32), **query
        )

    def _refine_distances(
        self, face: Int64Array, coarse: Float32Array, start: Float64Array, direction: Float64Array
    ) -> Float64Array:
        """Compute hit distances in float64, except along faces and at tiny faces."""
        # Along a face, and past a tiny one, Embree is more exact than the plane.
        exact = self.plane_distance(face, start, direction)
        return np.where(np.abs(exact - coarse) <= 1e-3 * (1e-2 + np.abs(coarse)), exact, coarse)


def _as_rays(origins: ArrayLike, directions: ArrayLike) -> tuple[Float64Array, Float64Array]:
    direction = np.asarray(directions, np.float64)
    return np.broadcast_to(np.asarray(origins, np.float64), direction.shape), direction


@functools.cache
def _installed() -> RayLibrary:
    return "embree" if find_spec("embreex") else "numpy"


@functools.cache
def _device() -> Any:
    """Return the shared Embree device; creating a device takes longer than the ray casts of one
    body.
    """
    from embreex.rtcore import EmbreeDevice

    return EmbreeDevice()


def _embree_scene(vertices: Float64Array, faces: Int64Array) -> tuple[Any, Any]:
    """Return a scene of Embree and its mesh, which the scene only refers to."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene(_device())
    return scene, TriangleMesh(scene, vertices.astype(np.float32), faces.astype(np.int32))


class _TriangleTree:
    """Tree of boxes with level sides over triangles, walked by all rays at once, for machines
    without Embree.

    Triangles with a coordinate that is not finite are skipped. Coordinates are rows, (3, n): NumPy
    is several times as fast on long rows as on triples.

    Args:
        corners: (F, 3, 3) metres.
    """

    def __init__(self, corners: Float64Array) -> None:
        chosen = np.flatnonzero(np.isfinite(corners).all((1, 2)))
        low = corners[chosen].min(1).T
        high = corners[chosen].max(1).T
        extent = (high.max(1, initial=-np.inf) - low.min(1, initial=np.inf)).max()
        margin = _MARGIN * max(float(extent), 1e-30)
        # Triangles that follow each other in the tree are near each other.
        order = cKDTree((low + high).T, leafsize=_FAN).indices
        self._face: Int64Array = chosen[order]
        self._corners = np.ascontiguousarray(corners[self._face].transpose(1, 2, 0))
        self._levels = [np.concatenate([low[:, order] - margin, high[:, order] + margin])]
        while self._levels[-1].shape[1] > _FAN:
            first = np.arange(0, self._levels[-1].shape[1], _FAN)
            low = self._levels[-1][:3]
            high = self._levels[-1][3:]
            self._levels.append(
                np.concatenate(
                    [
                        np.minimum.reduceat(low, first, axis=1),
                        np.maximum.reduceat(high, first, axis=1),
                    ]
                )
            )

    def first(
        self, origins: Float64Array, directions: Float64Array
    ) -> tuple[Int64Array, Float64Array, Float64Array]:
        """Find the first triangle on each ray.

        Args:
            origins: (n, 3).
            directions: (n, 3), of any length.

        Returns:
            face: (n,) int64, -1 without a hit; of triangles at one distance that with the lowest
                index.
            distance: (n,) in lengths of the direction, inf without a hit.
            uv: (n, 2) barycentric coordinates of the second and third corner.
        """
        face = np.full(len(origins), -1, np.int64)
        distance = np.full(len(origins), np.inf)
        uv = np.zeros((len(origins), 2))
        for start in range(0, len(origins), _BLOCK):
            rows = slice(start, start + _BLOCK)
            origin = np.ascontiguousarray(origins[rows].T)
            direction = np.ascontiguousarray(directions[rows].T)
            ray, triangle = self._pairs(origin, direction)
            ray, triangle, along, u, v = _intersect(ray, triangle, origin, direction, self._corners)
            order = np.lexsort((self._face[triangle], along, ray))
            ray, nearest = np.unique(ray[order], return_index=True)
            chosen = order[nearest]
            face[start + ray] = self._face[triangle[chosen]]
            distance[start + ray] = along[chosen]
            uv[start + ray] = np.stack([u[chosen], v[chosen]], 1)
        return face, distance, uv

    def _pairs(
        self, origin: Float64Array, direction: Float64Array
    ) -> tuple[Int64Array, Int64Array]:
        """Return the pairs of ray and triangle where the ray, a column of (3, n), hits the box of
        the triangle.
        """
        inverse = 1 / np.where(np.abs(direction) < 1e-30, 1e-30, direction)
        ray, node = (np.arange(n) for n in (origin.shape[1], self._levels[-1].shape[1]))
        ray, node = np.repeat(ray, len(node)), np.tile(node, len(ray))
        for depth, boxes in enumerate(reversed(self._levels)):
            if depth:
                ray = np.repeat(ray, _FAN)
                node = (node[:, None] * _FAN + np.arange(_FAN)).ravel()
                is_inside = node < boxes.shape[1]
                ray = ray[is_inside]
                node = node[is_inside]
            enters = np.zeros(len(ray))
            leaves = np.full(len(ray), np.inf)
            for axis in range(3):
                start = origin[axis, ray]
                scale = inverse[axis, ray]
                ends = (boxes[axis, node] - start) * scale, (boxes[axis + 3, node] - start) * scale
                enters = np.maximum(enters, np.minimum(*ends))
                leaves = np.minimum(leaves, np.maximum(*ends))
            met = enters <= leaves
            ray = ray[met]
            node = node[met]
        return ray, node


def _intersect(
    ray: Int64Array,
    triangle: Int64Array,
    origin: Float64Array,
    direction: Float64Array,
    corners: Float64Array,
) -> tuple[Int64Array, Int64Array, Float64Array, Float64Array, Float64Array]:
    """Intersect pairs of rays and triangles (Moeller and Trumbore 1997): pairs that meet,
    distances, coordinates.
    """
    start, second, third = corners[..., triangle]
    first = second - start
    second = third - start
    direction = direction[:, ray]
    across = np.cross(direction, second, axis=0)
    slope = _dot(first, across)
    offset = origin[:, ray] - start
    turned = np.cross(offset, first, axis=0)
    scale = 1 / np.where(slope == 0, np.inf, slope)
    u = _dot(offset, across) * scale
    v = _dot(direction, turned) * scale
    along = _dot(second, turned) * scale
    met = (slope != 0) & (u >= -_MARGIN) & (v >= -_MARGIN) & (u + v <= 1 + _MARGIN) & (along >= 0)
    return ray[met], triangle[met], along[met], u[met], v[met]


def _dot(a: Float64Array, b: Float64Array) -> Float64Array:
    """Return the dot products (n,) of vectors (3, n), in an order that is the same on every
    processor.
    """
    total: Float64Array = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return total
