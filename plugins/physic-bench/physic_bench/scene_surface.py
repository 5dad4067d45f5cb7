"""Signed distance of points to the mesh of a scanned scene.

The distance is that to the nearest point of a triangle. A point is inside where it lies behind that triangle. A scan is
open: far behind a wall, or beside an edge of the scan, "inside" means nothing, so that it ends at a reach.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.body.convert.nearest_surface import closest_barycentric
from physic_core.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_bench.contract import Surface

    Array = NDArray[np.float64]

INSIDE_REACH_M = 0.15
"""A vertex counts as inside up to this depth, as in the released code's rule of contact."""

MAX_EDGE_M, MIN_EDGE_M, MEDIAN_EDGES = 0.25, 0.02, 3.0
"""Edges longer than three times the median are split, within these limits: few long triangles of a scan would make the
search for the nearest one long everywhere, since a triangle is found by its centre."""

EXACT_WITHIN_M = 0.16
"""Largest distance that a rule of contact asks for, and a margin."""

CELL_M = 0.05
"""The search far from the surface uses one triangle per cell of this side: over a flat sheet, its nearest centre is
less than 4 mm farther than the sheet."""

_AROUND = 8
"""Triangles around the foot of a perpendicular that are tested."""

_STEPS = 2
_CHUNK = 1000
"""Points whose candidates are in memory at a time."""

_TIE = 1e-9


@dataclass(frozen=True, eq=False)
class SceneIndex:
    """Search structure over the triangles of a scene; build it once per mesh.

    Attributes:
        corners: (T, 3, 3) m.
        centres: (T, 3) m.
        normals: (T, 3) unit, by counter-clockwise corners.
        radii: (T,) m, the largest distance from a triangle's centre to its corners.
        radius: m, the largest of them.
        coarse: rows of one triangle per cell of CELL_M.
        tree: of the centres.
        coarse_tree: of the centres of ``coarse``.
    """

    corners: Array
    centres: Array
    normals: Array
    radii: Array
    radius: float
    coarse: NDArray[np.int64]
    tree: Any
    coarse_tree: Any

    @classmethod
    def build(cls, surface: Surface) -> SceneIndex:
        """Build the index.

        Raises:
            InputError: the surface has no triangles.
        """
        from scipy.spatial import KDTree
        from trimesh.remesh import subdivide_to_size

        vertices, faces = np.asarray(surface.vertices, np.float64), np.asarray(surface.faces, np.int64)
        if not len(faces):
            raise InputError("the mesh of the scene has no triangles: signed distances need a mesh, not points")
        sides = vertices[faces] - vertices[np.roll(faces, 1, axis=1)]
        lengths = np.linalg.norm(sides, axis=-1)
        longest = float(np.clip(MEDIAN_EDGES * np.median(lengths), MIN_EDGE_M, MAX_EDGE_M))
        long = lengths.max(1) > longest
        corners = vertices[faces[~long]]
        if long.any():
            vertices, faces = subdivide_to_size(vertices, faces[long], longest, max_iter=30)
            corners = np.concatenate([corners, vertices[faces]])
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(across, axis=-1)
        corners, across, area = corners[area > 0], across[area > 0], area[area > 0]
        centres = corners.mean(1)
        radii = np.linalg.norm(corners - centres[:, None], axis=-1).max(1)
        coarse = _one_per_cell(centres)
        trees = KDTree(centres), KDTree(centres[coarse])
        return cls(corners, centres, across / area[:, None], radii, float(radii.max()), coarse, *trees)

    def signed_distance(self, points: Array, reach: float = 1.0) -> Array:
        """Return the signed distance (N,) m of points (N, 3), negative behind the surface; inf beyond ``reach``.

        It is exact up to EXACT_WITHIN_M. Farther points get the distance to the sheet of the surface that has the
        nearest centre of ``coarse``, which is at most a cell's diagonal longer than the distance.
        """
        points = np.asarray(points, np.float64)
        answer = np.full(len(points), np.inf)
        rows = np.flatnonzero(np.isfinite(points).all(-1))
        slack = self.radius + 3**0.5 * CELL_M
        apart, row = self.coarse_tree.query(points[rows], distance_upper_bound=reach + slack)
        within = np.isfinite(apart)
        rows, apart, near = rows[within], apart[within], self.coarse[row[within]]
        if not len(rows):
            return answer
        close = apart <= EXACT_WITHIN_M + slack
        near[close] = self.tree.query(points[rows[close]])[1]
        answer[rows] = self._descend(points[rows], near)
        rows = rows[close]
        for start in range(0, len(rows), _CHUNK):
            part = rows[start : start + _CHUNK]
            answer[part] = self._exact(points[part], answer[part])
        return np.where(np.abs(answer) <= reach, answer, np.inf)

    def _descend(self, points: Array, near: NDArray[np.int64]) -> Array:
        """Return the signed distance (n,) of points to the sheet that a triangle of each (n,) belongs to.

        The nearest triangle is searched around the foot of the perpendicular onto the plane of the one before.
        """
        for _ in range(_STEPS):
            height = ((points - self.centres[near]) * self.normals[near]).sum(-1)
            foot = points - height[:, None] * self.normals[near]
            # A foot that is far from every triangle lies beyond an edge of the sheet.
            around = self.tree.query(foot, k=_AROUND, distance_upper_bound=self.radius + CELL_M)[1]
            own = near[:, None]
            around = np.where(around < len(self.corners), around, own)
            near, distance = self._nearest(points, np.concatenate([own, around], 1))
        return distance

    def _exact(self, points: Array, known: Array) -> Array:
        """Return the signed distance (n,) of points, given that to some triangle; exact up to EXACT_WITHIN_M."""
        limit = np.abs(known)
        listed = self.tree.query_ball_point(points, np.minimum(limit, EXACT_WITHIN_M) + self.radius)
        point = np.repeat(np.arange(len(points)), [len(own) for own in listed])
        triangle = np.fromiter(chain.from_iterable(listed), np.int64, len(point))
        way = points[point] - self.centres[triangle]
        # A triangle lies in the disc around its centre: nothing of it is nearer than the disc.
        height = (way * self.normals[triangle]).sum(-1) ** 2
        beside = np.sqrt(np.maximum((way * way).sum(-1) - height, 0)) - self.radii[triangle]
        possible = height + np.maximum(beside, 0) ** 2 <= (limit[point] + _TIE) ** 2
        point, triangle = point[possible], triangle[possible]
        distance, height = self._distances(points[point], triangle)
        least = limit.copy()
        np.minimum.at(least, point, distance)
        nearest = distance <= least[point] + _TIE
        point, distance, height = point[nearest], distance[nearest], height[nearest]
        order = np.lexsort((np.abs(height), point))  # the last of each point is that of _nearest
        found = known.copy()
        found[point[order]] = np.copysign(distance, np.where(height < 0, -1.0, 1.0))[order]
        return found

    def _nearest(self, points: Array, rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array]:
        """Return the nearest of some triangles (n, k), and the signed distance (n,) to it."""
        distance, height = self._distances(points[:, None], rows)
        # At an edge, the triangle that the point lies most in front of or behind decides which side it is on.
        nearest = distance <= distance.min(1, keepdims=True) + _TIE
        best = np.where(nearest, np.abs(height), -1.0).argmax(1)
        row = np.arange(len(points))
        found: Array = np.copysign(distance[row, best], np.where(height[row, best] < 0, -1.0, 1.0))
        return rows[row, best], found

    def _distances(self, points: Array, rows: NDArray[np.int64]) -> tuple[Array, Array]:
        """Return the distance (...,) to triangles, and the height over their planes."""
        corners = self.corners[rows]
        on = (closest_barycentric(corners, points)[..., None] * corners).sum(-2)
        way = points - on
        return np.linalg.norm(way, axis=-1), (way * self.normals[rows]).sum(-1)


def _one_per_cell(centres: Array) -> NDArray[np.int64]:
    cells = np.floor((centres - centres.min(0)) / CELL_M).astype(np.int64)
    size = cells.max(0) + 1
    rows: NDArray[np.int64] = np.unique(
        (cells[:, 0] * size[1] + cells[:, 1]) * size[2] + cells[:, 2], return_index=True
    )[1]
    return rows


def contact_by_rule(distance: Array, threshold_m: float) -> NDArray[np.bool_]:
    """Return which vertices touch: within a threshold of the scene, or inside it by at most 15 cm.

    Args:
        distance: (...,) m, signed, negative inside.
        threshold_m: 0.02 in the released code of PhySIC, 0.05 in POSA.
    """
    found: NDArray[np.bool_] = (np.abs(distance) <= threshold_m) | ((distance < 0) & (distance >= -INSIDE_REACH_M))
    return found
