"""Render meshes by ray casting and points as squares, on the CPU without display.

Colours are sRGB in 0-1; row 0 of an image is its top.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

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
    "merge_layers",
    "prepare_meshes",
    "render_mesh",
    "render_points",
]

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
    bodies: Sequence[Array], faces: NDArray[Any], *, smooth: bool = True, longest_edge: float = math.inf
) -> RayCastMesh | None:
    """Concatenate N bodies with common faces for ray casting; None without bodies.

    Args:
        bodies: vertices of each body, (V, 3) metres.
        faces: (F, 3) of one body.
        smooth: whether to compute normals; otherwise they are zero.
        longest_edge: of a triangle, metres; others are left out. It bounds the time for bodies of a degenerate backend,
            of which each triangle may cover the image.
    """
    import trimesh

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
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    normals = np.asarray(mesh.vertex_normals) if smooth else np.zeros_like(vertices)
    return RayCastMesh(vertices, triangles, normals, RayCaster(vertices, triangles))


def render_mesh(shapes: RayCastMesh, viewer: ViewCamera, colors: Array, *, lit: bool = True, samples: int = 2) -> Layer:
    """Render meshes by ray casting.

    Args:
        shapes: meshes in the frame of ``viewer``.
        viewer: the camera.
        colors: (N * V, 3) sRGB of each vertex.
        lit: whether to apply lighting; colours of a photo need none.
        samples: rays along each side of a pixel.
    """
    import cv2

    color = np.zeros((viewer.height, viewer.width, 4), np.float32)
    distance = np.full((viewer.height, viewer.width), np.inf, np.float32)
    spots = viewer.project(shapes.vertices)[:, :2]
    if np.isnan(spots).all():
        return Layer(color[..., :3], color[..., 3], distance)
    size = viewer.width, viewer.height
    x0, y0 = (int(np.clip(np.floor(np.nanmin(spots[:, axis])) - 1, 0, size[axis])) for axis in (0, 1))
    x1, y1 = (int(np.clip(np.ceil(np.nanmax(spots[:, axis])) + 2, 0, size[axis])) for axis in (0, 1))
    if x0 >= x1 or y0 >= y1:
        return Layer(color[..., :3], color[..., 3], distance)
    columns = np.arange(x0 * samples, x1 * samples) / samples - 0.5 + 0.5 / samples
    rows = np.arange(y0 * samples, y1 * samples) / samples - 0.5 + 0.5 / samples
    grid = np.meshgrid(columns, rows)
    hit, rgb, far = _cast_rays(shapes, viewer, colors, grid[0].ravel(), grid[1].ravel(), lit)
    fine = np.zeros((grid[0].size, 4), np.float32)
    fine[hit, :3], fine[hit, 3] = rgb, 1.0
    depth = np.full(grid[0].size, np.inf, np.float32)
    depth[hit] = far
    box = (x1 - x0, y1 - y0)
    color[y0:y1, x0:x1] = cv2.resize(fine.reshape(*grid[0].shape, 4), box, interpolation=cv2.INTER_AREA)
    distance[y0:y1, x0:x1] = (
        depth.reshape(box[1], samples, box[0], samples).transpose(0, 2, 1, 3).reshape(box[1], box[0], -1).min(-1)
    )
    return Layer(color[..., :3], color[..., 3], distance)


def composite(layer: Layer, picture: NDArray[np.float32], opacity: float = 1.0) -> NDArray[np.float32]:
    """Composite a rendered layer over an opaque image (H, W, 3) in 0-1."""
    return layer.color * opacity + picture * (1.0 - opacity * layer.alpha[..., None])


def render_points(viewer: ViewCamera, points: Array, colors: Array) -> Layer:
    """Render points (N, 3) with sRGB colours (N, 3) as squares of 3 px, nearest on top."""
    shape = viewer.height + 2, viewer.width + 2  # a rim of one pixel, so that the squares need no clipping
    color, distance = np.zeros((*shape, 3), np.float32), np.full(shape, np.inf, np.float32)
    spots = viewer.project(points)
    with np.errstate(invalid="ignore"):
        inside = (spots[:, :2] > -0.5).all(-1) & (spots[:, 0] < viewer.width) & (spots[:, 1] < viewer.height)
    order = np.flatnonzero(inside)
    order = order[np.argsort(-spots[order, 2])]  # numpy keeps the last of several writes: the nearest come last
    columns, rows = np.round(spots[order, :2]).astype(np.int64).T + 1
    distance[rows, columns] = spots[order, 2]
    color[rows, columns] = np.asarray(colors, np.float32)[order]
    sparse, tints = distance.copy(), color.copy()
    for dy in (0, 1, 2):
        for dx in (0, 1, 2):
            window = slice(dy, dy + viewer.height), slice(dx, dx + viewer.width)
            nearer = sparse[window] < distance[1:-1, 1:-1]
            distance[1:-1, 1:-1][nearer] = sparse[window][nearer]
            color[1:-1, 1:-1][nearer] = tints[window][nearer]
    distance = distance[1:-1, 1:-1]
    return Layer(color[1:-1, 1:-1], np.isfinite(distance).astype(np.float32), distance)


def merge_layers(back: Layer, front: Layer, margin: float) -> Layer:
    """Merge two layers: ``front`` is visible unless ``back`` is nearer by more than ``margin`` metres."""
    first = (front.alpha[..., None] > 0) & ~(back.distance < front.distance - margin)[..., None]
    under = front.color + back.color * (1.0 - front.alpha[..., None])
    veil = front.alpha + back.alpha * (1.0 - front.alpha)
    return Layer(
        np.where(first, under, back.color),
        np.where(first[..., 0], veil, back.alpha),
        np.minimum(front.distance, back.distance),
    )


def _cast_rays(
    shapes: RayCastMesh, viewer: ViewCamera, colors: Array, columns: Array, rows: Array, lit: bool
) -> tuple[NDArray[np.int64], Array, Array]:
    """Cast rays; return the indices of those that hit, and colour and distance of each hit."""
    origins, directions = viewer.rays(columns, rows)
    triangle = shapes.caster.first_faces(origins, directions)
    hit = np.flatnonzero(triangle >= 0)
    corners = shapes.faces[triangle[hit]]
    weights, spots = _barycentric(shapes.vertices[corners], origins[hit], directions[hit])
    base = np.einsum("nkc,nk->nc", np.asarray(colors)[corners], weights)
    if not lit:
        return hit, base, viewer.project(spots)[:, 2]
    normals = np.einsum("nkc,nk->nc", shapes.normals[corners], weights)
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)
    return hit, _shade(normals, directions[hit], viewer.light_axes(), base), viewer.project(spots)[:, 2]


def _barycentric(triangles: Array, origins: Array, directions: Array) -> tuple[Array, Array]:
    """Return barycentric weights (N, 3) and hit points (N, 3) of rays that hit triangles (N, 3, 3)."""
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    normal = np.cross(first, second)
    slope = (normal * directions).sum(-1)
    slope = np.where(np.abs(slope) < 1e-15, 1e-15, slope)  # seen edge on: the clip below keeps it finite
    distance = (normal * (triangles[:, 0] - origins)).sum(-1) / slope
    spots = origins + distance[:, None] * directions
    area = np.maximum((normal * normal).sum(-1), 1e-30)
    offset = spots - triangles[:, 0]
    beta = np.clip((np.cross(offset, second) * normal).sum(-1) / area, 0.0, 1.0)
    gamma = np.clip((np.cross(first, offset) * normal).sum(-1) / area, 0.0, 1.0 - beta)
    weights = np.stack([1.0 - beta - gamma, beta, gamma], -1)
    return weights, np.einsum("nkc,nk->nc", triangles, weights)


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
