"""How far a body is from the scene that was reconstructed with it: a measure of its own, whatever engine made the two.

Metres, OpenCV camera frame (x right, y down, z forward). A point map shows front sides only, so that three things need
care:

* Distance is taken to the surface that the points sample and not to the points: along the normal of the nearest one,
  plus what lies beside it beyond the spacing of the points there. A vertex between four pixels of a floor is on it.
* A vertex behind a visible surface counts as inside it, up to ``reach``, unless the camera sees past it to something
  farther: what lies before the point map is in free space. Nobody knows what is behind a table's front: vertices that
  are hidden behind something must be left out by whoever knows it (:func:`hidden_behind`).
* Under the floor's plane a vertex is inside whatever the points say.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.metrics.shapes import require_same_shape

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Intrinsics, Plane

__all__ = ["REACH", "SceneDistance", "hidden_behind", "point_spacing", "scene_distance"]

REACH = 0.15
"""Metres beyond which nothing is near (the released code's radius)."""

_LEVEL = 0.17  # sine of 10 degrees


@dataclass(frozen=True)
class SceneDistance:
    """Distance from each vertex to the scene, and the surface normal there, for vertices (..., V).

    Attributes:
        distance: (..., V) float64 m, negative inside; inf where nothing is within reach.
        normal: (..., V, 3) float64 unit, of the surface there, out of the scene; zero where it is unknown.
    """

    distance: FloatArray
    normal: FloatArray


def scene_distance(
    vertices: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    valid: BoolArray,
    intrinsics: Intrinsics,
    floor: Plane | None = None,
    reach: float = REACH,
) -> SceneDistance:
    """Signed distance of vertices to a point map and to its floor.

    Args:
        vertices: (..., V, 3) m.
        points: (H, W, 3) m, the scene without people.
        normals: (H, W, 3) unit, towards the camera; zero where unreliable: such a point has no inside.
        valid: (H, W) bool.
        intrinsics: camera of the point map.
        floor: its plane, or None.
        reach: farther surfaces are not looked for, m.

    Raises:
        PhysicError: points and normals are not of one shape.
    """
    from scipy.spatial import KDTree

    require_same_shape("points and normals", points, normals)
    flat = np.asarray(vertices, np.float64).reshape(-1, 3)
    answer, towards = np.full(len(flat), np.inf), np.zeros((len(flat), 3))
    if len(flat):
        spacing = point_spacing(points, normals, valid)
        low, high = flat.min(0) - reach, flat.max(0) + reach
        with np.errstate(invalid="ignore"):
            near = valid & (points >= low).all(-1) & (points <= high).all(-1)
        cloud, facing, gap = (np.asarray(a[near], np.float64) for a in (points, normals, spacing))
        if len(cloud):
            distance, row = KDTree(cloud).query(flat, distance_upper_bound=reach)
            found = np.isfinite(distance)
            row = row[found]
            way = flat[found] - cloud[row]
            along = (facing[row] * way).sum(1)
            beside = np.linalg.norm(way - along[:, None] * facing[row], axis=1)
            to_surface = np.hypot(along, np.maximum(beside - gap[row], 0.0))
            oriented = (facing[row] ** 2).sum(1) > 0.5
            size = np.where(oriented, to_surface, distance[found])
            free = ~_behind(flat[found], np.where(valid, points[..., 2], np.inf), intrinsics, 0.0)
            answer[found] = np.where(oriented & (along < 0) & ~free, -size, size)
            towards[found] = facing[row]
    if floor is not None:
        height = flat @ np.asarray(floor.normal, np.float64) + floor.offset
        plane = ((np.abs(height) < reach) & (np.abs(height) < np.abs(answer))) | (height <= -reach)
        answer = np.where(plane, np.maximum(height, -reach), answer)
        towards[plane] = floor.normal
    return SceneDistance(answer.reshape(vertices.shape[:-1]), towards.reshape(vertices.shape))


def hidden_behind(
    vertices: FloatArray, depth: FloatArray, intrinsics: Intrinsics, tolerance: float = 0.03
) -> BoolArray:
    """Vertices (..., V) bool in front of which a depth map has something.

    Args:
        vertices: (..., V, 3) m.
        depth: (H, W) m along z, of the scene without people; inf or NaN hides nothing.
        intrinsics: its camera.
        tolerance: a vertex hides only this far behind, m.
    """
    return _behind(np.asarray(vertices, np.float64), depth, intrinsics, tolerance)


def _behind(points: FloatArray, depth: FloatArray, intrinsics: Intrinsics, tolerance: float) -> BoolArray:
    """Whether the nearest of the four pixels around each point (..., 3) is nearer than the point; False off the image.

    All four, since at a rim the nearest pixel alone may be the background's.
    """
    ahead = points[..., 2] > 1e-6
    z = np.where(ahead, points[..., 2], 1.0)
    column = np.floor(intrinsics.fx * points[..., 0] / z + intrinsics.cx)
    row = np.floor(intrinsics.fy * points[..., 1] / z + intrinsics.cy)
    height, width = depth.shape
    inside = ahead & (column >= 0) & (column < width - 1) & (row >= 0) & (row < height - 1)
    u, v = (np.where(inside, value, 0).astype(int) for value in (column, row))
    corners = np.stack([depth[v + j, u + i] for j in (0, 1) for i in (0, 1)])
    nearest = np.where(np.isfinite(corners), corners, np.inf).min(0)
    behind: BoolArray = inside & (nearest < points[..., 2] - tolerance)
    return behind


def point_spacing(points: FloatArray, normals: FloatArray, valid: BoolArray) -> FloatArray:
    """How densely a point map samples its surfaces: (H, W) float64 m.

    The distance from each point to the farthest of its four neighbours on the same surface, which are those that lie
    within 10 degrees of its tangent plane, and it of theirs; 0 where there is none.

    Args:
        points: (H, W, 3) m.
        normals: (H, W, 3) unit, or zero where unknown: such a point has no neighbours.
        valid: (H, W) bool.
    """
    spacing = np.zeros(valid.shape)
    for axis in (0, 1):
        first, second = ((slice(None),) * axis + (part,) for part in (slice(None, -1), slice(1, None)))
        with np.errstate(invalid="ignore"):
            step = np.asarray(points[second] - points[first], np.float64)
            length = np.linalg.norm(step, axis=-1)
            off = [np.abs((step * normals[side]).sum(-1)) for side in (first, second)]
        level = np.maximum(*off) <= _LEVEL * length
        oriented = (np.square(normals).sum(-1) > 0.5) & valid
        length = np.where(oriented[first] & oriented[second] & level, length, 0.0)
        for side in (first, second):
            np.maximum(spacing[side], length, out=spacing[side])
    return spacing
