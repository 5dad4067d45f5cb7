"""Bodies, points of the scene, and their colours for the preview."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.geometry.upright import gltf_from_camera, transform_points
from physic_core.visual.palette import person_color
from physic_core.visual.render import LONGEST_BODY_EDGE_M, RayCastMesh, prepare_meshes
from physic_core.visual.surface import depth_limit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Reconstruction, Scene

    Array = NDArray[np.float64]

__all__ = ["PreviewGeometry", "build_preview_geometry"]

_POINTS = 1_200_000


@dataclass(frozen=True)
class PreviewGeometry:
    """Bodies and points of the preview, and their colours; camera frame, metres.

    Attributes:
        people: bodies; None if there are none.
        people_colors: (N * V, 3) sRGB in 0-1.
        points: (M, 3) points of the scene.
        point_colors: (M, 3) sRGB in 0-1.
        spacing: of points on a surface that faces the camera, at the median depth, metres.
        upright: (4, 4), see :func:`physic_core.geometry.upright.gltf_from_camera`.
        low: (3,) minimum corner of the box around the people, upright frame; around most of the scene without people.
        high: (3,) maximum corner.
        has_floor: whether y = 0 is a floor.
    """

    people: RayCastMesh | None
    people_colors: Array
    points: Array
    point_colors: Array
    spacing: float
    upright: Array
    low: Array
    high: Array
    has_floor: bool


def build_preview_geometry(reconstruction: Reconstruction) -> PreviewGeometry:
    """Build the preview geometry of a reconstruction, without people with non-finite vertices."""
    scene, limit = reconstruction.scene, depth_limit(reconstruction)
    matrix = gltf_from_camera(scene.floor)
    finite = [
        (index, np.asarray(person.vertices, np.float64))
        for index, person in enumerate(reconstruction.people)
        if np.isfinite(person.vertices).all()
    ]
    bodies = [vertices for _, vertices in finite]
    colors = [np.tile(np.array(person_color(index)) / 255.0, (len(vertices), 1)) for index, vertices in finite]
    stride = max(1, math.ceil(math.sqrt(scene.valid.size / _POINTS)))
    points, point_colors = _cloud(scene, limit, stride)
    depth = float(np.median(points[:, 2])) if len(points) else 0.0
    low, high = _bounds([transform_points(matrix, vertices) for vertices in bodies], transform_points(matrix, points))
    return PreviewGeometry(
        people=prepare_meshes(bodies, reconstruction.faces, longest_edge=LONGEST_BODY_EDGE_M),
        people_colors=np.concatenate(colors) if colors else np.zeros((0, 3)),
        points=points,
        point_colors=point_colors,
        spacing=stride * depth / reconstruction.intrinsics.fx,
        upright=matrix,
        low=low,
        high=high,
        has_floor=scene.floor is not None,
    )


def _cloud(scene: Scene, limit: float, stride: int) -> tuple[Array, Array]:
    """Return scene points (M, 3) of every n-th pixel up to a depth in metres, and their sRGB colours."""
    points, valid = scene.points[::stride, ::stride], scene.valid[::stride, ::stride]
    with np.errstate(invalid="ignore"):
        valid = valid & np.isfinite(points).all(-1) & (points[..., 2] < limit)
    return points[valid].astype(np.float64), scene.colors[::stride, ::stride][valid] / 255.0


def _bounds(people: Sequence[Array], points: Array) -> tuple[Array, Array]:
    if people:
        vertices = np.concatenate(people)
        return vertices.min(0), vertices.max(0)
    if len(points):
        low, high = np.percentile(points, [5, 95], axis=0)
        return low, high
    return np.array([-1.0, -1.0, -3.0]), np.array([1.0, 1.0, -1.0])
