"""Signed distance of points to the mesh of a scanned scene.

The distance is that to the nearest point of a triangle. A point is inside where it lies behind that
triangle. A scan is open: far behind a wall, or beside an edge of the scan, "inside" means nothing,
so that it ends at a reach.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import InputError
from physic_testing.metrics import PROXIMITY_RADIUS_M

if TYPE_CHECKING:
    from physic_bench.types import Surface
    from physic_core.types import BoolArray, Float64Array, Int64Array


MIN_EDGE_M = 0.02
MAX_EDGE_M = 0.1
MEDIAN_EDGES = 3.0
"""Edges longer than three times the median are split, within these limits: a triangle is found by
its centre, and few long ones would make the search long everywhere.
"""

MAX_TRIANGLES = 2_000_000
"""About how many triangles a scene may be split into: those of a plane of a kilometre, split to the
longest edge above, do not fit into memory.
"""

_CHUNK = 500
"""Points whose triangles are in memory at a time."""

_TIE = 1e-9

_HALVED = 8  # triangles that halving leaves of the square of the longest edge


@dataclass(frozen=True, eq=False)
class SceneIndex:
    """Search structure over the triangles of a scene; build it once per mesh.

    Attributes:
        corners: (T, 3, 3) m.
        normals: (T, 3) unit, by counter-clockwise corners.
        radius: m, the largest distance from a triangle's centre to its corners.
        tree: of the centres.
    """

    corners: Float64Array
    normals: Float64Array
    radius: float
    tree: Any

    @classmethod
    def build(cls, surface: Surface) -> SceneIndex:
        """Build the index.

        Raises:
            InputError: the surface has no triangles.
        """
        from scipy.spatial import KDTree
        from trimesh.remesh import subdivide_to_size

        if not len(surface.faces):
            raise InputError(
                "the mesh of the scene has no triangles: signed distances need a mesh, not points"
            )
        corners = np.asarray(surface.vertices, np.float64)[surface.faces]
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1)
        sides = corners[:, 1:] - corners[:, :1]
        total = float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=-1).sum()) / 2
        longest = float(np.clip(MEDIAN_EDGES * np.median(edges), MIN_EDGE_M, MAX_EDGE_M))
        longest = max(longest, math.sqrt(_HALVED * total / MAX_TRIANGLES))
        vertices, faces = subdivide_to_size(surface.vertices, surface.faces, longest, max_iter=30)
        corners = np.asarray(vertices, np.float64)[faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(across, axis=-1, keepdims=True)
        has_area = area[:, 0] > 0
        corners = corners[has_area]
        normals = across[has_area] / area[has_area]
        centres = corners.mean(1)
        radius = float(np.linalg.norm(corners - centres[:, None], axis=-1).max())
        return cls(corners, normals, radius, KDTree(centres))

    def signed_distance(
        self, points: Float64Array, reach: float = PROXIMITY_RADIUS_M
    ) -> Float64Array:
        """Return the signed distance (N,) m of points (N, 3), negative behind the surface; inf
        beyond ``reach``.
        """
        answer = np.full(len(points), np.inf)
        near = np.flatnonzero(np.isfinite(points).all(-1))
        nearest = self.tree.query(points[near], distance_upper_bound=reach + self.radius)[0]
        near = near[np.isfinite(nearest)]
        nearest = nearest[np.isfinite(nearest)]
        # The nearest triangle is no farther than the nearest centre, and its own centre a radius
        # beyond at most.
        listed = self.tree.query_ball_point(points[near], np.minimum(nearest, reach) + self.radius)
        for start in range(0, len(near), _CHUNK):
            rows = listed[start : start + _CHUNK]
            part = near[start : start + _CHUNK]
            point = np.repeat(np.arange(len(part)), [len(triangles) for triangles in rows])
            triangle = np.fromiter(chain.from_iterable(rows), np.int64, len(point))
            answer[part] = self._nearest(points[part], point, triangle)
        return np.where(np.abs(answer) <= reach, answer, np.inf)

    def _nearest(
        self, points: Float64Array, point: Int64Array, triangle: Int64Array
    ) -> Float64Array:
        """Return the signed distance (N,) of points to the nearest of their triangles, of pairs
        (P,) of both.
        """
        from trimesh.triangles import closest_point

        corners = self.corners[triangle]
        offset = points[point] - closest_point(corners, points[point])
        distance = np.linalg.norm(offset, axis=-1)
        height = (offset * self.normals[triangle]).sum(-1)
        least = np.full(len(points), np.inf)
        np.minimum.at(least, point, distance)
        # At an edge, the triangle that the point lies most in front of or behind decides which side
        # it is on.
        tied = np.flatnonzero(distance <= least[point] + _TIE)
        tied = tied[np.lexsort((np.abs(height[tied]), point[tied]))]
        least[point[tied]] = np.copysign(distance, np.where(height < 0, -1.0, 1.0))[tied]
        return least


def contact_by_rule(distance: Float64Array, threshold_m: float) -> BoolArray:
    """Return which vertices touch: within a threshold of the scene, or inside it by at most 15 cm.

    Args:
        distance: (...,) m, signed, negative inside.
        threshold_m: 0.02 in the released code of PhySIC, 0.05 in POSA.
    """
    return (np.abs(distance) <= threshold_m) | ((distance < 0) & (distance >= -PROXIMITY_RADIUS_M))
