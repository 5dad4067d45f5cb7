"""Side and top views of a reconstruction for the preview, and the geometry that they show; orthographic."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.geometry.upright import gltf_from_camera, transform_points
from physic_core.visual.palette import person_color
from physic_core.visual.render import (
    LONGEST_BODY_EDGE_M,
    Orthographic,
    RayCastMesh,
    composite,
    prepare_meshes,
    render_mesh,
    render_points,
)
from physic_core.visual.surface import depth_limit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from physic_core.types import Reconstruction, Scene, UInt8Array

    Array = NDArray[np.float64]

__all__ = [
    "BACKGROUND_RGB",
    "PAGE_RGB",
    "LabeledView",
    "PreviewGeometry",
    "build_preview_geometry",
    "side_view",
    "top_view",
]

_POINTS = 1_200_000  # at most


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


PAGE_RGB = (250, 250, 248)
"""sRGB colour of the page."""

BACKGROUND_RGB = (214, 215, 213)
"""sRGB colour behind scenes, on which sand, snow and sky are visible."""

_SIDE_MARGIN = 0.4  # metres beside the people that the side view shows in full colour
_FAINT = 0.3  # weight of the colour of distant points against the background
_THICK = 0.03  # metres; a point is hidden only if the surface is nearer by more than this
_MIN_SCALE_RATIO = 0.85  # least ratio of the scales with and without the camera
_POINT_RADIUS, _MAX_RADIUS_PX = 1.2, 6  # of a drawn point, in spacings of points, and px
_OCCLUDED_OPACITY = 0.6  # opacity of occluded people: feet behind a table must be visible

_AXES = {"right": (1.0, 0.0, 0.0), "up": (0.0, 1.0, 0.0), "ahead": (0.0, 0.0, -1.0)}  # in the upright (glTF) frame


@dataclass(frozen=True)
class LabeledView:
    """Orthographic image of the scene and the positions of its labels, px.

    Attributes:
        picture: (H, W, 3) uint8 RGB.
        pixels_per_metre: scale.
        floor_row: row of the floor; None if there is no floor, or in the top view.
        camera: column and row of the camera; None if it is outside.
    """

    picture: UInt8Array
    pixels_per_metre: float
    floor_row: float | None
    camera: tuple[float, float] | None


def side_view(geometry: PreviewGeometry, width: int, height: int) -> LabeledView:
    """Render the view from the camera's right, parallel to the floor; the camera looks towards the image's right."""
    low, high, eye = geometry.low, geometry.high, geometry.upright[:3, 3]
    bottom = min(low[1], 0.0) if geometry.has_floor else low[1]
    rows = [bottom - 0.35, high[1] + 0.25]
    ahead = [-high[2] - 0.8, -low[2] + 0.8]
    ahead, rows = _include_camera(ahead, rows, [-0.35, eye[1] - 0.2, eye[1] + 0.25], width, height)
    view = _fit_view(geometry, ahead, rows, ("ahead", "up", "right"), high[0] + _SIDE_MARGIN, (width, height))
    right = transform_points(geometry.upright, geometry.points)[:, 0]
    picture = _render(geometry, view, right < high[0] + _SIDE_MARGIN, right < low[0] - _SIDE_MARGIN)
    floor_row = None
    if geometry.has_floor:
        turn = geometry.upright[:3, :3]
        floor_row = float(view.project(-(turn.T @ eye)[None])[0, 1])
    return LabeledView(picture, view.pixels_per_metre, floor_row, _camera_pixel(view))


def top_view(geometry: PreviewGeometry, width: int, height: int) -> LabeledView:
    """Render the view from above, clipped at the height of the people; the camera looks towards the image's top."""
    low, high = geometry.low, geometry.high
    across, ahead = [low[0] - 0.9, high[0] + 0.9], [-high[2] - 0.9, -low[2] + 0.9]
    ahead, across = _include_camera(ahead, across, [-0.3, -0.3, 0.3], height, width)
    view = _fit_view(geometry, across, ahead, ("right", "ahead", "up"), high[1] + 0.1, (width, height))
    height_m = transform_points(geometry.upright, geometry.points)[:, 1]
    picture = _render(geometry, view, height_m < high[1] + 0.1, np.zeros(len(height_m), bool))
    return LabeledView(picture, view.pixels_per_metre, None, _camera_pixel(view))


def _include_camera(
    ahead: list[float], across: list[float], camera: Sequence[float], along: int, beside: int
) -> tuple[list[float], list[float]]:
    """Extend the ranges of a view to include the camera, if the scale decreases little.

    Args:
        ahead: range of distances ahead of the camera, metres.
        across: range of the other axis, metres.
        camera: start of ``ahead``, then the range of the other axis that the camera needs, metres.
        along: px along ``ahead``.
        beside: px along ``across``.
    """
    wide = [min(ahead[0], camera[0]), ahead[1]], [min(across[0], camera[1]), max(across[1], camera[2])]

    def scale(first: list[float], second: list[float]) -> float:
        return min(along / (first[1] - first[0]), beside / (second[1] - second[0]))

    return wide if scale(*wide) >= _MIN_SCALE_RATIO * scale(ahead, across) else (ahead, across)


def _fit_view(
    geometry: PreviewGeometry,
    columns: Sequence[float],
    rows: Sequence[float],
    axes: tuple[str, str, str],
    cut: float,
    size: tuple[int, int],
) -> Orthographic:
    """Create a view of two ranges (metres) of the named axes, clipped nearer than ``cut``, of width x height px."""
    width, height = size
    along, top, towards = (np.array(_AXES[name]) for name in axes)
    scale = min(width / (columns[1] - columns[0]), height / (rows[1] - rows[0]))
    # Free space goes to the top, so that the ground is at the bottom of every image.
    middle = rows[0] + height / scale / 2 if axes[1] == "up" else sum(rows) / 2
    center = along * sum(columns) / 2 + top * middle
    turn = geometry.upright[:3, :3]
    return Orthographic(
        center=turn.T @ (center - geometry.upright[:3, 3]),
        right=turn.T @ along,
        top=turn.T @ top,
        pixels_per_metre=scale,
        width=width,
        height=height,
        start=float(cut - center @ towards),
    )


def _render(
    geometry: PreviewGeometry, view: Orthographic, kept: NDArray[np.bool_], faint: NDArray[np.bool_]
) -> UInt8Array:
    """Render people and some of the points of the scene, of which some are faint, (M,) bool each."""
    paper = np.array(BACKGROUND_RGB) / 255
    tints = np.where(faint[:, None], _FAINT * geometry.point_colors + (1 - _FAINT) * paper, geometry.point_colors)
    radius = int(np.clip(round(_POINT_RADIUS * geometry.spacing * view.pixels_per_metre), 1, _MAX_RADIUS_PX))
    scene = render_points(view, geometry.points[kept], tints[kept], radius)
    picture = composite(scene, np.broadcast_to(paper.astype(np.float32), (view.height, view.width, 3)))
    if geometry.people is not None:
        people = render_mesh(geometry.people, view, geometry.people_colors)
        veil = np.where(scene.distance < people.distance - _THICK, _OCCLUDED_OPACITY, 1.0).astype(np.float32)[..., None]
        picture = people.color * veil + picture * (1.0 - people.alpha[..., None] * veil)
    return (np.clip(picture, 0.0, 1.0) * 255 + 0.5).astype(np.uint8)


def _camera_pixel(view: Orthographic) -> tuple[float, float] | None:
    """Project the camera centre to column and row; None if it is outside the image."""
    column, row, _ = view.project(np.zeros((1, 3)))[0]
    return (float(column), float(row)) if 0 <= column < view.width and 0 <= row < view.height else None
