"""Distances of people to a scene: signed, hidden ones, penetration and gaps.

Metres, OpenCV camera frame (x right, y down, z forward); depth is along z.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.metrics.shapes import require_same_shape

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Intrinsics, Plane

PROXIMITY_RADIUS_M = 0.15
"""Default search radius, metres, as in the released code."""


def scene_distance(
    vertices: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    valid: BoolArray,
    intrinsics: Intrinsics,
    floor: Plane | None = None,
    reach: float = PROXIMITY_RADIUS_M,
) -> FloatArray:
    """Return the signed distance (..., V) float64 m of vertices to a point map and its floor,
    negative inside; inf without a surface within reach.

    Args:
        vertices: (..., V, 3) m.
        points: (H, W, 3) m, the scene without people.
        normals: (H, W, 3) unit, towards the camera; zero where unknown: such a point has no inside.
        valid: (H, W) bool.
        intrinsics: of the point map.
        floor: plane, or None.
        reach: search radius, m.

    Raises:
        PhysicError: the shapes of points and normals differ.
    """
    require_same_shape("points and normals", points, normals)
    flat = np.asarray(vertices, np.float64).reshape(-1, 3)
    answer = _distance_to_points(flat, points, normals, valid, intrinsics, reach)
    if floor is not None:
        height = flat @ np.asarray(floor.normal, np.float64) + floor.offset
        plane = ((np.abs(height) < reach) & (np.abs(height) < np.abs(answer))) | (height <= -reach)
        answer = np.where(plane, np.maximum(height, -reach), answer)
    return answer.reshape(vertices.shape[:-1])


def _distance_to_points(
    flat: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    valid: BoolArray,
    intrinsics: Intrinsics,
    reach: float,
) -> FloatArray:
    """Return the distance (n,) of vertices (n, 3) without the floor, as :func:`scene_distance`
    does.
    """
    from scipy.spatial import KDTree

    answer = np.full(len(flat), np.inf)
    spacing = point_spacing(points, normals, valid)
    low = flat.min(0, initial=np.inf) - reach
    high = flat.max(0, initial=-np.inf) + reach
    with np.errstate(invalid="ignore"):
        near = valid & (points >= low).all(-1) & (points <= high).all(-1)
    if near.any():
        cloud, facing, gap = (np.asarray(a[near], np.float64) for a in (points, normals, spacing))
        distance, row = KDTree(cloud).query(flat, distance_upper_bound=reach)
        is_near = np.isfinite(distance)
        row = row[is_near]
        offset = flat[is_near] - cloud[row]
        along = (facing[row] * offset).sum(1)
        beside = np.linalg.norm(offset - along[:, None] * facing[row], axis=1)
        to_surface = np.hypot(along, np.maximum(beside - gap[row], 0.0))
        oriented = (facing[row] ** 2).sum(1) > 0.5
        size = np.where(oriented, to_surface, distance[is_near])
        free = ~_behind(flat[is_near], np.where(valid, points[..., 2], np.inf), intrinsics, 0.0)
        answer[is_near] = np.where(oriented & (along < 0) & ~free, -size, size)
    return answer


def hidden_by_depth_map(
    vertices: FloatArray, depth: FloatArray, intrinsics: Intrinsics, tolerance: float = 0.03
) -> BoolArray:
    """Return whether a depth map hides each vertex: (..., V) bool.

    Args:
        vertices: (..., V, 3) m.
        depth: (H, W) m along z, of the scene without people; inf or NaN hides nothing.
        intrinsics: of the depth map.
        tolerance: least distance of a hidden vertex behind the surface, m.
    """
    return _behind(np.asarray(vertices, np.float64), depth, intrinsics, tolerance)


def _behind(
    points: FloatArray, depth: FloatArray, intrinsics: Intrinsics, tolerance: float
) -> BoolArray:
    """Return whether each point (..., 3) is behind the nearest of the four pixels around it; False
    outside the image.

    At a depth edge, a single pixel may show the background.
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


_LEVEL = 0.17  # sine of 10 degrees


def point_spacing(points: FloatArray, normals: FloatArray, valid: BoolArray) -> FloatArray:
    """Return the spacing (H, W) float64 m between neighbouring points of a point map on the same
    surface.

    The spacing is the largest distance from a point to its four neighbours on the same surface. Two
    neighbours are on the same surface if each is within 10 degrees of the other's tangent plane.
    The spacing is 0 without such neighbours.

    Args:
        points: (H, W, 3) m.
        normals: (H, W, 3) unit, or zero where unknown: such a point has no neighbours.
        valid: (H, W) bool.
    """
    spacing = np.zeros(valid.shape)
    for axis in (0, 1):
        first, second = (
            (slice(None),) * axis + (part,) for part in (slice(None, -1), slice(1, None))
        )
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


@dataclass(frozen=True)
class Penetration:
    """Penetration of people, each (...,) float64; zero without a vertex inside.

    Attributes:
        max_depth: metres, of the deepest vertex.
        mean_depth: metres, over the vertices inside.
    """

    max_depth: FloatArray
    mean_depth: FloatArray


def penetration(distance: FloatArray) -> Penetration:
    """Compute the depth of the vertices inside the scene, of signed distances (..., V), m."""
    inside = np.isfinite(distance) & (distance < 0)
    depth = np.where(inside, -np.asarray(distance, np.float64), 0.0)
    return Penetration(
        max_depth=depth.max(-1, initial=0.0),
        mean_depth=depth.sum(-1) / np.maximum(inside.sum(-1), 1),
    )


def contact_gap(
    distance: FloatArray, contact: BoolArray, reach: float = float("inf")
) -> FloatArray:
    """Return the mean gap (...,) m from true contact vertices to the scene; a vertex inside the
    scene has gap 0.

    Args:
        distance: (..., V) m, signed, of the predicted body in the predicted scene.
        contact: (..., V) bool, true contact.
        reach: upper limit of a gap, also of unknown ones.

    Returns:
        float64; NaN without true contact.
    """
    distance = np.asarray(distance, np.float64)
    outside = np.where(np.isnan(distance), np.inf, np.maximum(distance, 0.0))
    gap = np.where(contact, np.minimum(outside, reach), 0.0)
    number = contact.sum(-1)
    return np.where(number > 0, gap.sum(-1) / np.maximum(number, 1), np.nan)
