"""Views of a reconstruction for the preview, and the geometry that they show: from aside, and to
scale.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import JOINT_INDEX
from physic_core.geometry import transform_points, world_from_camera
from physic_core.types import main_people
from physic_visual.palette import person_color
from physic_visual.render import (
    View,
    blend_over,
    picture_bytes,
    render_mesh,
    render_points,
)
from physic_visual.scene_mesh import is_near, scene_meshes, scene_reach
from physic_visual.textures.dressed import dressed_bodies

if TYPE_CHECKING:
    from physic_core.geometry import RayCaster
    from physic_core.types import (
        Float32Array,
        Float64Array,
        Person,
        Reconstruction,
        Scene,
        UInt8Array,
    )


_POINTS = 200_000  # at most

PAGE_RGB = (250, 250, 248)
"""sRGB colour of the page."""

BACKGROUND_RGB = (214, 215, 213)
"""sRGB colour behind scenes, on which sand, snow and sky are visible."""


@dataclass(frozen=True)
class PreviewGeometry:
    """Bodies and points of the preview, and their colours; camera frame, metres.

    Attributes:
        people: bodies; None if there are none.
        people_colors: (N * V, 3) sRGB in 0-1, those of the people's numbers.
        dress_colors: (N * V, 3) sRGB in 0-1, those of the photo, see
            :mod:`physic_visual.textures.dressed`.
        crowns: person -> (3,) vertex of the head that is the highest.
        points: (M, 3) float32 points of the scene.
        point_colors: (M, 3) float32 sRGB in 0-1.
        backdrop: (K, 3) float32 points of what is farther, see
            :func:`physic_visual.scene_mesh.mesh_backdrop`.
        backdrop_colors: (K, 3) float32 sRGB in 0-1.
        spacing: of points on a surface that faces the camera, at the median depth, metres.
        upright: (4, 4), see :func:`physic_core.geometry.world_frame.world_from_camera`.
        low: (3,) minimum corner of the box around the main people, upright frame; around most of
            the scene without people.
        high: (3,) maximum corner.
        has_floor: whether y = 0 is a floor.
    """

    people: RayCaster | None
    people_colors: Float64Array
    dress_colors: Float64Array
    crowns: Mapping[int, Float64Array]
    points: Float32Array
    point_colors: Float32Array
    backdrop: Float32Array
    backdrop_colors: Float32Array
    spacing: float
    upright: Float64Array
    low: Float64Array
    high: Float64Array
    has_floor: bool


def build_preview_geometry(reconstruction: Reconstruction) -> PreviewGeometry:
    """Build the preview geometry of a reconstruction, without people with non-finite vertices."""
    scene = reconstruction.scene
    limit = scene_reach(reconstruction)
    matrix = world_from_camera(scene.level)
    bodies = {
        index: np.asarray(person.vertices, np.float64)
        for index, person in enumerate(reconstruction.people)
        if person.has_body
    }
    colors = [
        np.tile(np.array(person_color(index)) / 255.0, (len(vertices), 1))
        for index, vertices in bodies.items()
    ]
    stride = max(1, math.ceil(math.sqrt(scene.valid.size / _POINTS)))
    points, point_colors = _cloud(scene, limit, stride)
    dressed = dressed_bodies(reconstruction)
    dress = [one.colors for one in dressed.people.values()]
    backdrop, backdrop_colors = _backdrop_points(reconstruction)
    depth = float(np.median(points[:, 2])) if len(points) else 0.0
    main = set(main_people([person.box for person in reconstruction.people]))
    framed = [bodies[index] for index in bodies.keys() & main] or [*bodies.values()]
    low, high = _scene_bounds(framed, points, matrix)
    return PreviewGeometry(
        people=dressed.caster,
        people_colors=np.concatenate([np.zeros((0, 3)), *colors]),
        dress_colors=np.concatenate([np.zeros((0, 3)), *dress]) / 255.0,
        crowns={index: crown(reconstruction.people[index], matrix[1, :3]) for index in bodies},
        points=points,
        point_colors=point_colors,
        backdrop=backdrop,
        backdrop_colors=backdrop_colors,
        spacing=stride * depth / reconstruction.intrinsics.fx,
        upright=matrix,
        low=low,
        high=high,
        has_floor=scene.floor is not None,
    )


def crown(person: Person, up: Float64Array) -> Float64Array:
    """Return the highest vertex (3,) of a person's head, camera frame; a raised hand is higher.

    Args:
        person: with a body.
        up: (3,) unit vector.
    """
    vertices, joints = (np.asarray(part, np.float64) for part in (person.vertices, person.joints))
    head, neck = joints[[JOINT_INDEX["head"], JOINT_INDEX["neck"]]]
    from_head = np.linalg.norm(vertices - head, axis=1)
    reach = max(2 * float(np.linalg.norm(head - neck)), float(from_head.min()))
    near = vertices[from_head <= reach]
    highest: Float64Array = near[(near @ up).argmax()]
    return highest


def _cloud(scene: Scene, limit: float, stride: int) -> tuple[Float32Array, Float32Array]:
    """Return scene points (M, 3) of every n-th pixel up to a distance in metres, and their sRGB
    colours.
    """
    points = scene.points[::stride, ::stride]
    valid = scene.valid[::stride, ::stride] & is_near(points, limit)
    colors = scene.colors[::stride, ::stride][valid].astype(np.float32) / np.float32(255.0)
    return points[valid].astype(np.float32), colors


_WITHIN = np.array([0.6, 0.2, 0.2], np.float32)  # weights of the corners of a triangle


def _backdrop_points(result: Reconstruction) -> tuple[Float32Array, Float32Array]:
    """Return points (K, 3) on the triangles of the backdrop, and their sRGB colours."""
    mesh = scene_meshes(result)[1]
    colors = result.scene.colors
    corners = np.concatenate([mesh.faces, mesh.faces[:, [1, 2, 0]]])
    pixels = np.einsum("k,nkc->nc", _WITHIN, mesh.pixels[corners]).astype(np.int64)
    points: Float32Array = np.einsum("k,nkc->nc", _WITHIN, mesh.vertices[corners])
    return points, colors[pixels[:, 1], pixels[:, 0]] / np.float32(255.0)


def _scene_bounds(
    bodies: Sequence[Float64Array], points: Float32Array, upright: Float64Array
) -> tuple[Float64Array, Float64Array]:
    if bodies:
        vertices = transform_points(upright, np.concatenate(bodies))
        return vertices.min(0), vertices.max(0)
    if len(points):
        low, high = np.percentile(transform_points(upright, points), [5, 95], axis=0)
        return low, high
    return np.array([-1.0, -1.0, -3.0]), np.array([1.0, 1.0, -1.0])


@dataclass(frozen=True)
class LabeledView:
    """Orthographic image of the scene and the positions of its labels, px.

    Attributes:
        picture: (H, W, 3) uint8 RGB.
        pixels_per_metre: scale.
        floor_row: row of the floor; None if there is no floor, or in the top view.
        camera_px: column and row of the camera; None if it is outside.
        crowns: person -> column and row of the top of the head, of those in the picture.
    """

    picture: UInt8Array
    pixels_per_metre: float
    floor_row: float | None
    camera_px: tuple[float, float] | None
    crowns: Mapping[int, tuple[float, float]]


@dataclass(frozen=True)
class _Direction:
    """Direction of a view, and the room around people in it.

    Attributes:
        axes: (3, 3) towards the right, the top and the eye, upright (glTF) frame.
        room: (2, 2) metres below and above people, along the right and the top axis.
        camera_room: (2, 2) the same around the camera, if it is shown.
        beside: metres nearer to the eye than people, and farther from it, that are shown in full
            colour.
    """

    axes: Float64Array
    room: Float64Array
    camera_room: Float64Array
    beside: tuple[float, float]


_SIDE = _Direction(
    axes=np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]),
    room=np.array([[0.8, 0.8], [0.35, 0.25]]),
    camera_room=np.array([[0.35, 0.0], [0.2, 0.25]]),
    beside=(0.4, 0.4),
)


def side_view(geometry: PreviewGeometry, width: int, height: int) -> LabeledView:
    """Render the view from the camera's right, parallel to the floor; the camera looks towards the
    image's right.
    """
    return _render_view(geometry, _SIDE, (width, height))


_TOP = _Direction(
    axes=np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    room=np.full((2, 2), 0.9),
    camera_room=np.array([[0.3, 0.3], [0.3, 0.0]]),
    beside=(0.1, math.inf),
)


def top_view(geometry: PreviewGeometry, width: int, height: int) -> LabeledView:
    """Render the view from above, clipped at the height of the people; the camera looks towards the
    image's top.
    """
    return _render_view(geometry, _TOP, (width, height))


def view_from_aside(geometry: PreviewGeometry, width: int, height: int) -> UInt8Array:
    """Render the people from beside and above the photo's camera, with the scene and what is
    farther behind them.
    """
    low = geometry.low - 0.1
    high = geometry.high + 0.1
    corners = np.stack(np.meshgrid(*np.stack([low, high], 1)), -1).reshape(-1, 3)
    shown = replace(
        geometry,
        points=np.concatenate([geometry.points, geometry.backdrop]),
        point_colors=np.concatenate([geometry.point_colors, geometry.backdrop_colors]),
    )
    return _draw(
        shown, _camera_from_aside(geometry.upright, corners, width, height), math.inf, radius=2
    )


_ASIDE = 35.0  # degrees between the view from aside and the camera's direction
_ABOVE = 12.0  # degrees over the horizon
_FIELD = math.radians(40)  # of the upright view from aside
_FILLED = 0.8  # share of it that people fill


def _camera_from_aside(
    upright: Float64Array, corners: Float64Array, width: int, height: int
) -> View:
    """Return the nearest camera, beside and above the photo's, that sees all corners (N, 3,
    upright frame).
    """
    turn = upright[:3, :3]
    eye = upright[:3, 3]
    center = corners.mean(0)
    azimuth = math.atan2(eye[0] - center[0], eye[2] - center[2]) + math.radians(_ASIDE)
    rise = math.radians(_ABOVE)
    back = np.array(
        [math.sin(azimuth) * math.cos(rise), math.sin(rise), math.cos(azimuth) * math.cos(rise)]
    )
    right = np.cross([0.0, 1.0, 0.0], back) / math.cos(rise)
    axes = np.stack([right, np.cross(back, right), back])
    focal = _FILLED * height / (2 * math.tan(_FIELD / 2))
    spots = corners @ axes.T
    distance = 0.0
    position = np.zeros(3)
    for axis, room in enumerate((width, height)):
        slope = _FILLED * room / 2 / focal
        largest = (spots[:, axis] + slope * spots[:, 2]).max()
        least = (slope * spots[:, 2] - spots[:, axis]).max()
        position += (largest - least) / 2 * axes[axis]
        distance = max(distance, (largest + least) / 2 / slope)
    origin = turn.T @ (position + distance * back - eye)
    centre = (np.array([width, height]) - 1) / 2
    return View(
        axes * [[1.0], [-1.0], [-1.0]] @ turn,
        origin,
        np.full(2, focal),
        centre,
        (width, height),
        False,
    )


_POINT_RADIUS = 1.2  # of a drawn point, in spacings of points
_MAX_RADIUS_PX = 6


def _render_view(
    geometry: PreviewGeometry, direction: _Direction, size: tuple[int, int]
) -> LabeledView:
    """Render people and points; points nearer to the eye than people are skipped, distant ones are
    faint.
    """
    view, full_colour_m = _fitted(geometry, direction, size)
    scale = float(view.focal[0])
    radius = int(np.clip(round(_POINT_RADIUS * geometry.spacing * scale), 1, _MAX_RADIUS_PX))
    camera = -(geometry.upright[:3, :3].T @ geometry.upright[:3, 3])
    spots = view.project(np.stack([camera, np.zeros(3), *geometry.crowns.values()]))[:, :2]
    inside = np.asarray(((spots >= 0) & (spots < size)).all(1))
    ground, camera_place, *crowns = map(tuple, spots.tolist())
    return LabeledView(
        _draw(geometry, view, full_colour_m, radius),
        scale,
        floor_row=ground[1] if direction is _SIDE and geometry.has_floor else None,
        camera_px=camera_place if inside[1] else None,
        crowns={
            index: spot
            for index, spot, shown in zip(geometry.crowns, crowns, inside[2:], strict=True)
            if shown
        },
    )


def _fitted(
    geometry: PreviewGeometry, direction: _Direction, size: tuple[int, int]
) -> tuple[View, float]:
    """Return the view of people in a direction, and the distance up to which it shows points in
    full colour, metres.
    """
    turn = geometry.upright[:3, :3]
    eye = geometry.upright[:3, 3]
    axes = direction.axes
    low, high = np.sort(np.stack([geometry.low, geometry.high]) @ axes.T, axis=0)
    is_level = direction is _SIDE
    if is_level and geometry.has_floor:
        low[1] = min(low[1], 0.0)
    near = high[2] + direction.beside[0]
    far = low[2] - direction.beside[1]
    start, end = _range_with_camera(
        np.stack([low[:2], high[:2]]) + direction.room.T * [[-1], [1]], direction, axes @ eye, size
    )
    scale = float((size / (end - start)).min())
    middle = (start + end) / 2
    if is_level:  # free space goes to the top, so that the ground is at the bottom of every image
        middle[1] = start[1] + size[1] / scale / 2
    center = turn.T @ (axes[:2].T @ middle - eye)
    view = View.orthographic(axes @ turn, center, scale, size, start=float(near))
    return view, float(near - far)


_MIN_SCALE_RATIO = 0.85  # least ratio of the scales with and without the camera


def _range_with_camera(
    ends: Float64Array, direction: _Direction, eye: Float64Array, size: tuple[int, int]
) -> Float64Array:
    """Extend the range (2, 2) of a view, in metres along its axes, to the camera, if the scale
    decreases little.
    """
    below, above = direction.camera_room.T
    wide = np.stack([np.minimum(ends[0], eye[:2] - below), np.maximum(ends[1], eye[:2] + above)])
    scales = [(size / (one[1] - one[0])).min() for one in (wide, ends)]
    return wide if scales[0] >= _MIN_SCALE_RATIO * scales[1] else ends


_FAINT = 0.3  # weight of the colour of distant points against the background
_THICK = 0.03  # metres; a point is hidden only if the surface is nearer by more than this
_OCCLUDED_OPACITY = 0.6  # opacity of occluded people: feet behind a table must be visible


def _draw(geometry: PreviewGeometry, view: View, full_colour_m: float, radius: int) -> UInt8Array:
    """Draw people, and points of the scene, which are faint beyond a distance in metres, as squares
    around a pixel.
    """
    paper = (np.array(BACKGROUND_RGB) / 255).astype(np.float32)
    scene = render_points(view, geometry.points, geometry.point_colors, radius)
    veil = np.where(scene.distance > full_colour_m, _FAINT * scene.alpha, scene.alpha).astype(
        np.float32
    )[..., None]
    picture = veil * scene.color + (1 - veil) * paper
    if geometry.people is not None:
        people = render_mesh(geometry.people, view, geometry.dress_colors)
        veil = np.where(scene.distance < people.distance - _THICK, _OCCLUDED_OPACITY, 1.0).astype(
            np.float32
        )[..., None]
        picture = blend_over(people, picture, veil)
    return picture_bytes(picture)
