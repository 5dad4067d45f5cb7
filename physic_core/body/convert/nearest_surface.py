"""Find the point of a mesh that is nearest to each query point and has a similar normal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from physic_core.body.rotations import cross, unit

_Array = NDArray[np.float64]

_NORMAL_M = 0.05
"""Distance in metres that counts as much as one radian between normals."""
_CANDIDATES = 12
"""Number of triangles with the nearest centres that are tested for each point."""


@dataclass(frozen=True)
class SurfacePoints:
    """Points on the triangles of a mesh, in barycentric coordinates.

    Attributes:
        face: (n,) int64.
        shares: (n, 3) of its three corners, not negative, with sum 1.
        distance: (n,) metres from the query point.
        facing: (n,) cosine between the normals.
    """

    face: NDArray[np.int64]
    shares: _Array
    distance: _Array
    facing: _Array


class SurfaceIndex:
    """Search tree over the triangles of a mesh.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3).
    """

    def __init__(self, vertices: _Array, faces: NDArray[np.int64]) -> None:
        self.faces = faces
        self._corners = vertices[faces]
        a, b, c = (self._corners[:, k] for k in range(3))
        self.normals = unit(cross(b - a, c - a))
        self._tree = cKDTree(np.concatenate([self._corners.mean(1), _NORMAL_M * self.normals], 1))

    def nearest(self, points: _Array, normals: _Array) -> SurfacePoints:
        """Find the nearest surface points for ``points`` (n, 3) with unit ``normals`` (n, 3)."""
        features = np.concatenate([points, _NORMAL_M * normals], 1)
        _, candidates = self._tree.query(features, k=min(_CANDIDATES, len(self.faces)))
        candidates = candidates.reshape(len(points), -1)
        shares = closest_barycentric(self._corners[candidates], points[:, None])
        touched = (shares[..., None] * self._corners[candidates]).sum(-2)
        apart = np.linalg.norm(touched - points[:, None], axis=-1)
        facing = (self.normals[candidates] * normals[:, None]).sum(-1)
        best = (apart + _NORMAL_M * (1 - facing)).argmin(1)
        row = np.arange(len(points))
        return SurfacePoints(candidates[row, best], shares[row, best], apart[row, best], facing[row, best])


def closest_barycentric(corners: _Array, points: _Array) -> _Array:
    """Return barycentric coordinates (..., 3) of the points of triangles (..., 3, 3) nearest to ``points`` (..., 3)."""
    a, b, c = (corners[..., k, :] for k in range(3))
    first, second, there = b - a, c - a, points - a

    def dot(u: _Array, v: _Array) -> _Array:
        product: _Array = (u * v).sum(-1)
        return product

    d11, d12, d22 = dot(first, first), dot(first, second), dot(second, second)
    d1, d2 = dot(there, first), dot(there, second)
    area = np.maximum(d11 * d22 - d12 * d12, 1e-30)
    v, w = (d22 * d1 - d12 * d2) / area, (d11 * d2 - d12 * d1) / area
    inside = (v >= 0) & (w >= 0) & (v + w <= 1)
    # Otherwise it is on the nearest edge.
    along = [
        np.clip(d1 / np.maximum(d11, 1e-30), 0, 1),
        np.clip(d2 / np.maximum(d22, 1e-30), 0, 1),
        np.clip(dot(points - b, c - b) / np.maximum(dot(c - b, c - b), 1e-30), 0, 1),
    ]
    zero = np.zeros_like(v)
    edges = np.stack(
        [
            np.stack([1 - along[0], along[0], zero], -1),
            np.stack([1 - along[1], zero, along[1]], -1),
            np.stack([zero, 1 - along[2], along[2]], -1),
        ],
        -2,
    )
    apart = ((edges @ corners - points[..., None, :]) ** 2).sum(-1)
    nearest = np.take_along_axis(edges, apart.argmin(-1)[..., None, None], -2)[..., 0, :]
    return np.where(inside[..., None], np.stack([1 - v - w, v, w], -1), nearest)
