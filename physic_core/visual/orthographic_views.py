"""Orthographic side and top views of a reconstruction for the preview."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.geometry.upright import transform_points
from physic_core.visual.render import Orthographic, composite, merge_layers, render_mesh, render_points

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from physic_core.types import UInt8Array
    from physic_core.visual.preview_geometry import PreviewGeometry

    Array = NDArray[np.float64]

__all__ = ["BACKGROUND_RGB", "PAGE_RGB", "LabeledView", "side_view", "top_view"]

PAGE_RGB = (250, 250, 248)
"""sRGB colour of the page."""

BACKGROUND_RGB = (214, 215, 213)
"""sRGB colour behind scenes, on which sand, snow and sky are visible."""

_SIDE_MARGIN = 0.4  # metres beside the people that the side view shows in full colour
_FAINT = 0.3  # weight of the colour of distant points against the background
_THICK = 0.03  # metres; a point is hidden only if the surface is nearer by more than this
_MIN_SCALE_RATIO = 0.85  # least ratio of the scales with and without the camera
_MOST_TICKS = 100
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
        columns: distance from the camera in whole metres -> column; empty if that axis is vertical.
    """

    picture: UInt8Array
    pixels_per_metre: float
    floor_row: float | None
    camera: tuple[float, float] | None
    columns: dict[int, float]


def side_view(geometry: PreviewGeometry, width: int, height: int) -> LabeledView:
    """Render the view from the camera's right, parallel to the floor; the camera looks towards the image's right."""
    low, high, eye = geometry.low, geometry.high, geometry.upright[:3, 3]
    bottom = min(low[1], 0.0) if geometry.has_floor else low[1]
    rows = [bottom - 0.35, high[1] + 0.25]
    ahead = [-high[2] - 0.8, -low[2] + 0.8]
    ahead, rows = _include_camera(ahead, rows, [-0.35, eye[1] - 0.2, eye[1] + 0.25], width, height)
    view = _fit_view(geometry, ahead, rows, ("ahead", "up", "right"), high[0] + _SIDE_MARGIN, width, height)
    near = transform_points(geometry.upright, geometry.points)[:, 0]
    surface = None if geometry.surface is None else transform_points(geometry.upright, geometry.surface.vertices)[:, 0]
    picture = _render(
        geometry, view, near < high[0] + _SIDE_MARGIN, near < low[0] - _SIDE_MARGIN, surface, low[0] - _SIDE_MARGIN
    )
    metres = _ticks(max(0.0, ahead[0]), ahead[1])
    columns = {metre: _project(geometry, view, (0.0, 0.0, -float(metre)))[0] for metre in metres}
    floor_row = _project(geometry, view, (0.0, 0.0, 0.0))[1] if geometry.has_floor else None
    return LabeledView(picture, view.pixels_per_metre, floor_row, _camera_pixel(geometry, view), columns)


def top_view(geometry: PreviewGeometry, width: int, height: int) -> LabeledView:
    """Render the view from above, clipped at the height of the people; the camera looks towards the image's top."""
    low, high = geometry.low, geometry.high
    across, ahead = [low[0] - 0.9, high[0] + 0.9], [-high[2] - 0.9, -low[2] + 0.9]
    ahead, across = _include_camera(ahead, across, [-0.3, -0.3, 0.3], height, width)
    view = _fit_view(geometry, across, ahead, ("right", "ahead", "up"), high[1] + 0.1, width, height)
    near = transform_points(geometry.upright, geometry.points)[:, 1]
    picture = _render(geometry, view, near < high[1] + 0.1, np.zeros(len(near), bool), None, 0.0)
    return LabeledView(picture, view.pixels_per_metre, None, _camera_pixel(geometry, view), {})


def _ticks(low: float, high: float) -> range:
    """Return full metres of a range, each 1, 10, 100, ... so that there are at most ``_MOST_TICKS``."""
    step = 1
    while high - low > _MOST_TICKS * step:
        step *= 10
    return range(math.ceil(low / step) * step, math.floor(high) + 1, step)


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
    width: int,
    height: int,
) -> Orthographic:
    """Create a view of two ranges (metres) of the named axes, clipped nearer than ``cut``."""
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
    geometry: PreviewGeometry,
    view: Orthographic,
    kept: NDArray[np.bool_],
    faint: NDArray[np.bool_],
    surface: Array | None,
    faint_below: float,
) -> UInt8Array:
    """Render scene and people.

    ``surface`` is the coordinate of each mesh vertex along the view; vertices below ``faint_below`` are drawn faint.
    """
    paper = np.array(BACKGROUND_RGB) / 255
    picture = np.broadcast_to(paper.astype(np.float32), (view.height, view.width, 3))
    tints = np.where(faint[:, None], _FAINT * geometry.point_colors + (1 - _FAINT) * paper, geometry.point_colors)
    scene = render_points(view, geometry.points[kept], tints[kept])
    if geometry.surface is not None:
        colors = geometry.surface_colors
        if surface is not None:
            colors = np.where(surface[:, None] < faint_below, _FAINT * colors + (1 - _FAINT) * paper, colors)
        scene = merge_layers(scene, render_mesh(geometry.surface, view, colors, lit=False, samples=1), _THICK)
    picture = composite(scene, picture)
    if geometry.people is not None:
        people = render_mesh(geometry.people, view, geometry.people_colors)
        veil = np.where(scene.distance < people.distance - _THICK, _OCCLUDED_OPACITY, 1.0).astype(np.float32)[..., None]
        picture = people.color * veil + picture * (1.0 - people.alpha[..., None] * veil)
    return (np.clip(picture, 0.0, 1.0) * 255 + 0.5).astype(np.uint8)


def _project(geometry: PreviewGeometry, view: Orthographic, point: tuple[float, float, float]) -> tuple[float, float]:
    """Project a point of the upright frame to column and row."""
    turn = geometry.upright[:3, :3]
    column, row, _ = view.project((turn.T @ (np.array(point) - geometry.upright[:3, 3]))[None])[0]
    return float(column), float(row)


def _camera_pixel(geometry: PreviewGeometry, view: Orthographic) -> tuple[float, float] | None:
    """Project the camera centre to column and row; None if it is outside the image."""
    column, row, _ = view.project(np.zeros((1, 3)))[0]
    return (float(column), float(row)) if 0 <= column < view.width and 0 <= row < view.height else None
