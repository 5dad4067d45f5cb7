"""Signed distance of points to the mesh of a scanned scene.

The distance is that to the nearest point of a triangle. A point is inside where it lies behind that triangle. A scan is
open: far behind a wall, or beside an edge of the scan, "inside" means nothing, so that it ends at a reach.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.body.nearest_surface import closest_barycentric
from physic_core.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_evaluate.contract import Surface

    Array = NDArray[np.float64]

__all__ = ["RayCaster", "SceneIndex", "contact_by_rule"]

INSIDE_REACH_M = 0.15
"""A vertex counts as inside up to this depth, as in the released code's rule of contact."""

MAX_EDGE_M, MIN_EDGE_M, MEDIAN_EDGES = 0.25, 0.02, 3.0
"""Edges longer than three times the median are split, within these limits: few long triangles of a scan would make the
search for the nearest one long everywhere, since a triangle is found by its centre."""

EXACT_WITHIN_M = 0.16
"""Largest distance that a rule of contact asks for, and a margin."""

_FIRST, _MOST = 8, 512
_TIE = 1e-9


@dataclass(frozen=True, eq=False)
class SceneIndex:
    """Search structure over the triangles of a scene; build it once per mesh.

    Attributes:
        corners: (T, 3, 3) m.
        normals: (T, 3) unit, by counter-clockwise corners.
        radius: m, the largest distance from a triangle's centre to its corners.
        tree: of the centres.
    """

    corners: Array
    normals: Array
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

        vertices, faces = np.asarray(surface.vertices, np.float64), np.asarray(surface.faces, np.int64)
        if not len(faces):
            raise InputError("the mesh of the scene has no triangles: signed distances need a mesh, not points")
        sides = vertices[faces] - vertices[np.roll(faces, 1, axis=1)]
        lengths = np.linalg.norm(sides, axis=-1)
        longest = float(np.clip(MEDIAN_EDGES * np.median(lengths), MIN_EDGE_M, MAX_EDGE_M))
        if lengths.max() > longest:
            vertices, faces = subdivide_to_size(vertices, faces, longest, max_iter=30)
        corners = vertices[faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(across, axis=-1)
        corners, across, area = corners[area > 0], across[area > 0], area[area > 0]
        centres = corners.mean(1)
        radius = float(np.linalg.norm(corners - centres[:, None], axis=-1).max())
        return cls(corners, across / area[:, None], radius, KDTree(centres))

    def signed_distance(self, points: Array, reach: float = 1.0) -> Array:
        """Return the signed distance (N,) m of points (N, 3), negative behind the surface; inf beyond ``reach``.

        It is exact up to EXACT_WITHIN_M. Farther points get the distance to the sheet of the surface that has the
        nearest triangle centre, which is longer than the distance by less than a triangle's radius.
        """
        points = np.asarray(points, np.float64)
        answer = np.full(len(points), np.inf)
        count = min(_FIRST, len(self.corners))
        rows = np.flatnonzero(np.isfinite(points).all(-1))
        centre, near = self.tree.query(points[rows], k=count, distance_upper_bound=reach + self.radius)
        centre, near = centre.reshape(len(rows), count), near.reshape(len(rows), count)
        within = np.isfinite(centre[:, 0])
        rows, centre, near = rows[within], centre[within], near[within]
        if not len(rows):
            return answer
        # Places beyond the bound are filled with the nearest triangle.
        answer[rows], foot = self._nearest(points[rows], np.where(np.isfinite(centre), near, near[:, :1]))
        far = np.abs(answer[rows]) > EXACT_WITHIN_M
        if far.any():
            # The triangles around the foot of the perpendicular: the nearest of the same sheet.
            around = self.tree.query(foot[far], k=count)[1].reshape(-1, count)
            again, _ = self._nearest(points[rows[far]], around)
            answer[rows[far]] = np.where(np.abs(again) < np.abs(answer[rows[far]]), again, answer[rows[far]])
        near_enough = np.abs(answer[rows]) <= EXACT_WITHIN_M
        left = rows[near_enough & (centre[:, -1] < np.abs(answer[rows]) + self.radius)]
        while len(left) and count < min(len(self.corners), _MOST):
            count = min(4 * count, len(self.corners))
            centre, near = self.tree.query(points[left], k=count)
            answer[left], _ = self._nearest(points[left], near.reshape(len(left), count))
            # A triangle whose centre is farther than this cannot be nearer than the nearest so far.
            left = left[centre.reshape(len(left), count)[:, -1] < np.abs(answer[left]) + self.radius]
        return np.where(np.abs(answer) <= reach, answer, np.inf)

    def _nearest(self, points: Array, rows: NDArray[np.int64]) -> tuple[Array, Array]:
        """Return the signed distance (n,) to the nearest of some triangles (n, k), and the nearest points (n, 3)."""
        corners = self.corners[rows]
        shares = closest_barycentric(corners, points[:, None])
        on = (shares[..., None] * corners).sum(-2)
        way = points[:, None] - on
        distance = np.linalg.norm(way, axis=-1)
        height = (way * self.normals[rows]).sum(-1)
        # At an edge, the triangle that the point lies most in front of or behind decides which side it is on.
        nearest = distance <= distance.min(1, keepdims=True) + _TIE
        best = np.where(nearest, np.abs(height), -1.0).argmax(1)
        row = np.arange(len(points))
        found: Array = np.copysign(distance[row, best], np.where(height[row, best] < 0, -1.0, 1.0))
        return found, on[row, best]


@dataclass(frozen=True, eq=False)
class RayCaster:
    """Casts rays onto the triangles of a scene.

    Attributes:
        scene: of embree.
        mesh: of embree; kept, since the scene only refers to it.
    """

    scene: Any
    mesh: Any

    @classmethod
    def build(cls, surface: Surface) -> RayCaster:
        """Build the tree of embree."""
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        scene = EmbreeScene()
        vertices, faces = np.asarray(surface.vertices, np.float32), np.asarray(surface.faces, np.int32)
        return cls(scene, TriangleMesh(scene, vertices=vertices, indices=faces))

    def first_hit(self, origins: Array, directions: Array) -> Array:
        """Return the distance (n,) m to the first triangle of rays with origins (n, 3) and unit directions (n, 3)."""
        start, way = (np.ascontiguousarray(a, np.float32) for a in (origins, directions))
        found = self.scene.run(start, way, output=True)
        distance: Array = np.where(found["primID"] >= 0, found["tfar"], np.inf).astype(np.float64)
        return distance


def contact_by_rule(distance: Array, threshold_m: float) -> NDArray[np.bool_]:
    """Return which vertices touch: within a threshold of the scene, or inside it by at most 15 cm.

    Args:
        distance: (...,) m, signed, negative inside.
        threshold_m: 0.02 in the released code of PhySIC, 0.05 in POSA.
    """
    found: NDArray[np.bool_] = (np.abs(distance) <= threshold_m) | ((distance < 0) & (distance >= -INSIDE_REACH_M))
    return found
