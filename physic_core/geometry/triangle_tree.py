"""Ray casts in NumPy: a tree of boxes around triangles, walked by all rays at once.

Replaces Embree where that has no wheel; see :mod:`physic_core.geometry.rays`. Coordinates are rows, (3, n): NumPy is
several times as fast on long rows as on triples.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["TriangleTree"]

_FAN = 4  # children of a box
_BITS = 16  # per axis, of the cells by which triangles are sorted
_BLOCK = 1 << 14  # rays walked together, which bounds the memory
_MARGIN = 1e-9  # of the extent of all triangles and of a triangle's sides: no ray passes between neighbours

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class TriangleTree:
    """Tree of boxes with level sides over triangles; triangles with a coordinate that is not finite are left out.

    Args:
        corners: (F, 3, 3) metres.
    """

    def __init__(self, corners: Array) -> None:
        chosen = np.flatnonzero(np.isfinite(corners).all((1, 2)))
        low, high = corners[chosen].min(1).T, corners[chosen].max(1).T
        extent = np.ptp(corners[chosen], axis=(0, 1)) if len(chosen) else np.ones(3)
        margin = _MARGIN * max(float(extent.max()), 1e-30)
        cells = ((low + high) / 2 - low.min(1, keepdims=True, initial=np.inf)) / (extent[:, None] + margin)
        order = np.argsort(_along_curve((cells * (1 << _BITS)).astype(np.int64)), kind="stable")
        self._face: Indices = chosen[order]
        self._corners = np.ascontiguousarray(corners[self._face].transpose(1, 2, 0))
        self._levels = [np.concatenate([low[:, order] - margin, high[:, order] + margin])]
        while self._levels[-1].shape[1] > _FAN:
            first = np.arange(0, self._levels[-1].shape[1], _FAN)
            low, high = self._levels[-1][:3], self._levels[-1][3:]
            self._levels.append(
                np.concatenate([np.minimum.reduceat(low, first, axis=1), np.maximum.reduceat(high, first, axis=1)])
            )

    def first(self, origins: Array, directions: Array) -> tuple[Indices, Array, Array]:
        """Find the first triangle on each ray.

        Args:
            origins: (n, 3).
            directions: (n, 3), of any length.

        Returns:
            face: (n,) int64, -1 without a hit; of triangles at one distance that with the lowest index.
            distance: (n,) in lengths of the direction, inf without a hit.
            uv: (n, 2) barycentric coordinates of the second and third corner.
        """
        face = np.full(len(origins), -1, np.int64)
        distance, uv = np.full(len(origins), np.inf), np.zeros((len(origins), 2))
        for start in range(0, len(origins), _BLOCK):
            rows = slice(start, start + _BLOCK)
            origin, way = np.ascontiguousarray(origins[rows].T), np.ascontiguousarray(directions[rows].T)
            ray, triangle = self._pairs(origin, way)
            ray, triangle, along, u, v = _intersect(ray, triangle, origin, way, self._corners)
            order = np.lexsort((self._face[triangle], along, ray))
            ray, nearest = np.unique(ray[order], return_index=True)
            chosen = order[nearest]
            face[start + ray], distance[start + ray] = self._face[triangle[chosen]], along[chosen]
            uv[start + ray] = np.stack([u[chosen], v[chosen]], 1)
        return face, distance, uv

    def _pairs(self, origin: Array, way: Array) -> tuple[Indices, Indices]:
        """Return the pairs of rays, given by rows (3, n), and triangles whose boxes they meet."""
        inverse = 1 / np.where(np.abs(way) < 1e-30, 1e-30, way)
        ray, node = (np.arange(n) for n in (origin.shape[1], self._levels[-1].shape[1]))
        ray, node = np.repeat(ray, len(node)), np.tile(node, len(ray))
        for depth, boxes in enumerate(reversed(self._levels)):
            if depth:
                ray, node = np.repeat(ray, _FAN), (node[:, None] * _FAN + np.arange(_FAN)).ravel()
                there = node < boxes.shape[1]
                ray, node = ray[there], node[there]
            enters, leaves = np.zeros(len(ray)), np.full(len(ray), np.inf)
            for axis in range(3):
                start, scale = origin[axis, ray], inverse[axis, ray]
                ends = (boxes[axis, node] - start) * scale, (boxes[axis + 3, node] - start) * scale
                enters, leaves = np.maximum(enters, np.minimum(*ends)), np.minimum(leaves, np.maximum(*ends))
            met = enters <= leaves
            ray, node = ray[met], node[met]
        return ray, node


def _intersect(
    ray: Indices, triangle: Indices, origin: Array, way: Array, corners: Array
) -> tuple[Indices, Indices, Array, Array, Array]:
    """Intersect pairs of rays and triangles (Moeller and Trumbore 1997): pairs that meet, distances, coordinates."""
    start, second, third = corners[..., triangle]
    first, second, way = second - start, third - start, way[:, ray]
    across = _cross(way, second)
    slope = _dot(first, across)
    offset = origin[:, ray] - start
    turned = _cross(offset, first)
    scale = 1 / np.where(slope == 0, np.inf, slope)
    u, v, along = _dot(offset, across) * scale, _dot(way, turned) * scale, _dot(second, turned) * scale
    met = (slope != 0) & (u >= -_MARGIN) & (v >= -_MARGIN) & (u + v <= 1 + _MARGIN) & (along >= 0)
    return ray[met], triangle[met], along[met], u[met], v[met]


def _dot(a: Array, b: Array) -> Array:
    total: Array = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return total


def _cross(a: Array, b: Array) -> Array:
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _along_curve(cells: Indices) -> Indices:
    """Return the positions of cells (3, n) on a Morton curve, (n,)."""
    code = np.zeros(cells.shape[1], np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            code |= ((cells[axis] >> bit) & 1) << (3 * bit + axis)
    return code
