"""Render meshes by ray casting and points as squares, on the CPU without display.

Colours are sRGB in 0-1; row 0 of an image is its top.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.geometry.mesh import vertex_normals

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.geometry.rays import RayCaster
    from physic_core.types import Intrinsics

    Array = NDArray[np.float64]

__all__ = [
    "LONGEST_BODY_EDGE_M",
    "Layer",
    "Orthographic",
    "Perspective",
    "RayCastMesh",
    "ViewCamera",
    "composite",
    "prepare_meshes",
    "render_mesh",
    "render_points",
]

_RAYS = 2  # along each side of a pixel

LONGEST_BODY_EDGE_M = 2.0
"""Longest edge of a body's triangle that is drawn. Those of plausible bodies are up to 6 cm long."""


@dataclass(frozen=True)
class Perspective:
    """Pinhole camera at the origin of the OpenCV frame, with images of ``height`` x ``width`` px."""

    intrinsics: Intrinsics
    width: int
    height: int

    def project(self, points: Array) -> Array:
        """Project points (N, 3) to column and row in px, and distance from the camera in metres."""
        camera = self.intrinsics.resized(self.width, self.height)
        depth = points[:, 2]
        safe = np.where(depth > 1e-6, depth, np.nan)
        return np.stack(
            [points[:, 0] / safe * camera.fx + camera.cx, points[:, 1] / safe * camera.fy + camera.cy, depth], -1
        )

    def rays(self, columns: Array, rows: Array) -> tuple[Array, Array]:
        """Return origins and unit directions (N, 3) of the rays through columns and rows (N,)."""
        camera = self.intrinsics.resized(self.width, self.height)
        directions = np.stack(
            [(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones_like(rows)], -1
        )
        return np.zeros_like(directions), directions / np.linalg.norm(directions, axis=-1, keepdims=True)

    def light_axes(self) -> Array:
        """Return unit vectors (3, 3) towards the right, the top and the camera."""
        return np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])


@dataclass(frozen=True)
class Orthographic:
    """Orthographic camera.

    Attributes:
        center: (3,) metres, the point in the image centre.
        right: (3,) unit vector along the rows of the image.
        top: (3,) unit vector towards the top of the image, orthogonal to ``right``.
        pixels_per_metre: scale.
        width: px.
        height: px.
        start: metres in front of ``center`` where rays start; nearer geometry is clipped.
    """

    center: Array
    right: Array
    top: Array
    pixels_per_metre: float
    width: int
    height: int
    start: float = 50.0

    @property
    def towards_eye(self) -> Array:
        """Unit vector (3,) from the image plane to the camera."""
        return np.cross(self.right, self.top)

    def project(self, points: Array) -> Array:
        """See :class:`Perspective`; the distance is from a plane 1000 m in front of ``center``."""
        offset = points - self.center
        return np.stack(
            [
                offset @ self.right * self.pixels_per_metre + (self.width - 1) / 2,
                -(offset @ self.top) * self.pixels_per_metre + (self.height - 1) / 2,
                1000.0 - offset @ self.towards_eye,
            ],
            -1,
        )

    def rays(self, columns: Array, rows: Array) -> tuple[Array, Array]:
        """See :class:`Perspective`."""
        x = (columns - (self.width - 1) / 2) / self.pixels_per_metre
        y = -(rows - (self.height - 1) / 2) / self.pixels_per_metre
        origins = self.center + x[:, None] * self.right + y[:, None] * self.top + self.start * self.towards_eye
        return origins, np.broadcast_to(-self.towards_eye, origins.shape)

    def light_axes(self) -> Array:
        """See :class:`Perspective`."""
        return np.stack([self.right, self.top, self.towards_eye])


ViewCamera = Perspective | Orthographic


@dataclass(frozen=True)
class RayCastMesh:
    """Concatenated meshes of several bodies, prepared for ray casting.

    Attributes:
        vertices: (N * V, 3) metres.
        faces: (N * F, 3), counter-clockwise from outside.
        normals: (N * V, 3) unit.
        caster: of the faces.
    """

    vertices: Array
    faces: NDArray[np.int64]
    normals: Array
    caster: RayCaster


@dataclass(frozen=True)
class Layer:
    """Rendered image with transparency and distance.

    Attributes:
        color: (H, W, 3) float32, premultiplied by ``alpha``.
        alpha: (H, W) float32.
        distance: (H, W) float32 from the eye as in ``project`` of the camera, metres; inf where empty.
    """

    color: NDArray[np.float32]
    alpha: NDArray[np.float32]
    distance: NDArray[np.float32]


def prepare_meshes(
    bodies: Sequence[Array], faces: NDArray[Any], *, longest_edge: float = math.inf
) -> RayCastMesh | None:
    """Concatenate N bodies with common faces for ray casting; None without bodies.

    Args:
        bodies: vertices of each body, (V, 3) metres.
        faces: (F, 3) of one body.
        longest_edge: of a triangle, metres; others are left out. It bounds the time for bodies of a degenerate backend,
            of which each triangle may cover the image.
    """
    from physic_core.geometry.rays import RayCaster

    if not bodies or not len(faces):
        return None
    count = len(bodies[0])
    vertices = np.concatenate([np.asarray(body, np.float64) for body in bodies])
    triangles = np.concatenate([np.asarray(faces, np.int64) + index * count for index in range(len(bodies))])
    if math.isfinite(longest_edge):
        corners = vertices[triangles]
        length = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(1)
        triangles = triangles[length <= longest_edge]
        if not len(triangles):
            return None
    return RayCastMesh(vertices, triangles, vertex_normals(vertices, triangles), RayCaster(vertices, triangles))


def render_mesh(shapes: RayCastMesh, viewer: ViewCamera, colors: Array) -> Layer:
    """Render meshes by ray casting, with light from the upper left and four rays a pixel.

    Args:
        shapes: meshes in the frame of ``viewer``.
        viewer: the camera.
        colors: (N * V, 3) sRGB of each vertex.
    """
    import cv2

    color = np.zeros((viewer.height, viewer.width, 4), np.float32)
    distance = np.full((viewer.height, viewer.width), np.inf, np.float32)
    spots = viewer.project(shapes.vertices)[:, :2]
    size = np.array([viewer.width, viewer.height])
    low, high = np.nan_to_num(np.nanmin(spots, 0, initial=np.inf)), np.nan_to_num(np.nanmax(spots, 0, initial=-np.inf))
    x0, y0 = np.clip(np.floor(low) - 1, 0, size).astype(int).tolist()
    x1, y1 = np.clip(np.ceil(high) + 2, 0, size).astype(int).tolist()
    if x0 < x1 and y0 < y1:
        steps = [
            np.arange(start * _RAYS, end * _RAYS) / _RAYS - 0.5 + 0.5 / _RAYS for start, end in ((x0, x1), (y0, y1))
        ]
        columns, rows = np.meshgrid(*steps)
        fine = np.zeros((columns.size, 4), np.float32)
        depth = np.full(columns.size, np.inf, np.float32)
        hit, shaded, far = _cast_rays(shapes, viewer, colors, columns.ravel(), rows.ravel())
        fine[hit, :3], fine[hit, 3], depth[hit] = shaded, 1.0, far
        box = x1 - x0, y1 - y0
        color[y0:y1, x0:x1] = cv2.resize(fine.reshape(*columns.shape, 4), box, interpolation=cv2.INTER_AREA)
        distance[y0:y1, x0:x1] = depth.reshape(box[1], _RAYS, box[0], _RAYS).min((1, 3))
    return Layer(color[..., :3], color[..., 3], distance)


def composite(layer: Layer, picture: NDArray[np.float32], opacity: float = 1.0) -> NDArray[np.float32]:
    """Composite a rendered layer over an opaque image (H, W, 3) in 0-1."""
    return layer.color * opacity + picture * (1.0 - opacity * layer.alpha[..., None])


def render_points(viewer: ViewCamera, points: Array, colors: Array, radius: int = 1) -> Layer:
    """Render points (N, 3) with sRGB colours (N, 3) as squares of 2 ``radius`` + 1 px, the nearest on top."""
    # A rim of the squares' radius, so that they need no clipping.
    shape = viewer.height + 2 * radius, viewer.width + 2 * radius
    color, distance = np.zeros((*shape, 3), np.float32), np.full(shape, np.inf, np.float32)
    spots = viewer.project(points)
    with np.errstate(invalid="ignore"):
        inside = (spots[:, :2] > -0.5).all(-1) & (spots[:, 0] < viewer.width) & (spots[:, 1] < viewer.height)
    order = np.flatnonzero(inside)
    order = order[np.argsort(-spots[order, 2])]  # numpy keeps the last of several writes: the nearest come last
    columns, rows = np.round(spots[order, :2]).astype(np.int64).T + radius
    distance[rows, columns] = spots[order, 2]
    color[rows, columns] = np.asarray(colors, np.float32)[order]
    for axis in (0, 1):
        sparse, tints = distance.copy(), color.copy()
        for shift in (step for step in range(-radius, radius + 1) if step):
            moved = np.roll(sparse, shift, axis)
            nearer = moved < distance
            distance[nearer], color[nearer] = moved[nearer], np.roll(tints, shift, axis)[nearer]
    distance, color = (values[radius:-radius, radius:-radius] for values in (distance, color))
    return Layer(color, np.isfinite(distance).astype(np.float32), distance)


def _cast_rays(
    shapes: RayCastMesh, viewer: ViewCamera, colors: Array, columns: Array, rows: Array
) -> tuple[NDArray[np.int64], Array, Array]:
    """Cast rays; return the indices of those that hit, and colour and distance of each hit."""
    origins, directions = viewer.rays(columns, rows)
    hits = shapes.caster.first(origins, directions)
    hit = np.flatnonzero(hits.face >= 0)
    corners, weights = shapes.faces[hits.face[hit]], hits.corners[hit]
    spots = origins[hit] + hits.distance[hit, None] * directions[hit]
    base, normals = (np.einsum("nkc,nk->nc", values[corners], weights) for values in (colors, shapes.normals))
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)
    return hit, _shade(normals, directions[hit], viewer.light_axes(), base), viewer.project(spots)[:, 2]


def _shade(normals: Array, directions: Array, lights: Array, base: Array) -> Array:
    """Shade colours with a light from the upper left, a light from above and darker silhouettes."""
    right, top, eye = lights
    key = eye + 0.7 * top - 0.5 * right
    key /= np.linalg.norm(key)
    direct = np.clip(normals @ key, 0.0, 1.0)
    sky = 0.5 + 0.5 * (normals @ top)
    facing = np.clip(-(normals * directions).sum(-1), 0.0, 1.0)
    light = (0.34 + 0.52 * direct + 0.2 * sky) * (0.72 + 0.28 * facing**0.7)
    return np.asarray(np.clip(base * light[:, None], 0.0, 1.0))
