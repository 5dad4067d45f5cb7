"""Render meshes by ray casting and points as squares, on the CPU without display.

Colours are sRGB in 0-1; row 0 of an image is its top.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.geometry import RayCaster
    from physic_core.types import (
        Float32Array,
        Float64Array,
        FloatArray,
        Int64Array,
        Intrinsics,
        UInt8Array,
    )


_RAYS = 2  # along each side of a pixel that has an edge
_EDGE = 0.06  # difference of colour or coverage between neighbouring pixels that is an edge, of 1

LONGEST_BODY_EDGE_M = 2.0
"""Longest edge of a body's triangle that is drawn.

Those of plausible bodies are up to 6 cm long.
"""


@dataclass(frozen=True)
class View:
    """Camera of a picture, with a pinhole or with parallel rays.

    Attributes:
        axes: (3, 3) unit vectors towards the right, down and ahead, as rows.
        origin: (3,) metres, the pinhole, or a point of the plane in which parallel rays start;
            nearer geometry is not seen.
        focal: (2,) px; px per metre for parallel rays.
        centre: (2,) column and row of the ray that starts in ``origin``.
        size: width and height, px.
        is_parallel: whether rays are parallel.
    """

    axes: Float64Array
    origin: Float64Array
    focal: Float64Array
    centre: Float64Array
    size: tuple[int, int]
    is_parallel: bool

    @classmethod
    def perspective(cls, intrinsics: Intrinsics, width: int, height: int) -> View:
        """Return the camera of a photo, at the origin of the OpenCV frame, with pictures of width x
        height px.
        """
        camera = intrinsics.resized(width, height)
        focal = np.array([camera.fx, camera.fy])
        centre = np.array([camera.cx, camera.cy])
        return cls(np.eye(3), np.zeros(3), focal, centre, (width, height), False)

    @classmethod
    def orthographic(
        cls,
        axes: Float64Array,
        middle: Float64Array,
        scale: float,
        size: tuple[int, int],
        start: float = 50.0,
    ) -> View:
        """Return a view of parallel rays.

        Args:
            axes: (3, 3) unit vectors towards the right, the top and the eye, as rows.
            middle: (3,) metres, the point in the middle of the picture.
            scale: px per metre.
            size: width and height, px.
            start: metres in front of ``middle`` where rays start.
        """
        centre = (np.array(size) - 1) / 2
        origin = middle + start * axes[2]
        return cls(axes * [[1.0], [-1.0], [-1.0]], origin, np.full(2, scale), centre, size, True)

    def project(self, points: FloatArray) -> FloatArray:
        """Project points (N, 3) to column and row in px, and distance from the origin along the
        view in metres.
        """
        spots: FloatArray = (points - self.origin.astype(points.dtype)) @ self.axes.T.astype(
            points.dtype
        )
        if not self.is_parallel:
            spots[:, :2] /= np.where(spots[:, 2:] > 1e-6, spots[:, 2:], np.nan)
        spots[:, :2] *= self.focal
        spots[:, :2] += self.centre
        return spots

    def rays(self, columns: Float64Array, rows: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return origins and unit directions (N, 3) of the rays through columns and rows (N,)."""
        beside = ((np.stack([columns, rows], -1) - self.centre) / self.focal) @ self.axes[:2]
        if self.is_parallel:
            return self.origin + beside, np.broadcast_to(self.axes[2], beside.shape)
        directions = beside + self.axes[2]
        return np.zeros_like(directions) + self.origin, directions / np.linalg.norm(
            directions, axis=-1, keepdims=True
        )


@dataclass(frozen=True)
class RenderedLayer:
    """Rendered image with transparency and distance.

    Attributes:
        color: (H, W, C) float32, premultiplied by ``alpha``.
        alpha: (H, W) float32.
        distance: (H, W) float32 as in :meth:`View.project`, metres; inf where empty.
    """

    color: Float32Array
    alpha: Float32Array
    distance: Float32Array


def prepare_meshes(bodies: Sequence[Float64Array], faces: Int64Array) -> RayCaster | None:
    """Concatenate bodies (at least one) with common faces for ray casting; None without triangles.

    Triangles with an edge above :data:`LONGEST_BODY_EDGE_M` are skipped. It bounds the time for
    bodies of a degenerate backend, of which each triangle may cover the image.

    Args:
        bodies: vertices of each body, (V, 3) float64, metres.
        faces: (F, 3) of one body.
    """
    from physic_core.geometry import RayCaster

    vertices = np.concatenate(bodies)
    triangles = np.concatenate([faces + index * len(body) for index, body in enumerate(bodies)])
    # By columns: sums over an axis of three take several times as long.
    corners = [vertices[column].T for column in triangles.T]
    sides = zip(corners, [*corners[1:], corners[0]], strict=True)
    short = [np.square(end - start).sum(0) <= LONGEST_BODY_EDGE_M**2 for start, end in sides]
    triangles = triangles[np.logical_and.reduce(short)]
    return RayCaster(vertices, triangles) if len(triangles) else None


def render_mesh(shapes: RayCaster, viewer: View, colors: Float64Array) -> RenderedLayer:
    """Render meshes by ray casting: one ray a pixel, and four where there is an edge.

    Args:
        shapes: meshes in the frame of ``viewer``.
        viewer: the camera.
        colors: (N * V, C) of each vertex.
    """
    import cv2

    width, height = viewer.size
    color = np.zeros((height, width, colors.shape[1] + 1), np.float32)
    distance = np.full((height, width), np.inf, np.float32)
    (x0, y0), (x1, y1) = _box_around(viewer.project(shapes.vertices)[:, :2], viewer.size)
    if x0 < x1 and y0 < y1:
        columns, rows = np.meshgrid(
            np.arange(x0, x1, dtype=np.float64), np.arange(y0, y1, dtype=np.float64)
        )
        coarse, depth = _cast_rays(shapes, viewer, colors, columns, rows)
        near = np.ones((3, 3), np.uint8)
        steep = [cv2.dilate(one, near) - cv2.erode(one, near) > _EDGE for one in cv2.split(coarse)]
        edge = np.logical_or.reduce(steep)
        steps = (np.arange(_RAYS) + 0.5) / _RAYS - 0.5
        beside = np.tile(steps, _RAYS)
        below = np.repeat(steps, _RAYS)
        fine, deep = _cast_rays(
            shapes, viewer, colors, columns[edge, None] + beside, rows[edge, None] + below
        )
        coarse[edge] = fine.mean(1)
        depth[edge] = deep.min(1)
        color[y0:y1, x0:x1] = coarse
        distance[y0:y1, x0:x1] = depth
    return RenderedLayer(color[..., :-1], color[..., -1], distance)


def _box_around(spots: FloatArray, size: tuple[int, int]) -> list[list[int]]:
    """Return the first column and row of the pixels that contain spots (N, 2), and those behind the
    last.
    """
    low = np.nan_to_num(np.nanmin(spots, 0, initial=np.inf))
    high = np.nan_to_num(np.nanmax(spots, 0, initial=-np.inf))
    ends = np.stack([np.floor(low) - 1, np.ceil(high) + 2])
    box: list[list[int]] = np.clip(ends, 0, size).astype(int).tolist()
    return box


def blend_over(
    layer: RenderedLayer, picture: Float32Array, opacity: float | Float32Array = 1.0
) -> Float32Array:
    """Composite a rendered layer over an opaque image (H, W, 3) in 0-1, with one opacity or one per
    pixel (H, W, 1).
    """
    return layer.color * opacity + picture * (1.0 - opacity * layer.alpha[..., None])


def picture_bytes(picture: FloatArray) -> UInt8Array:
    """Return an image in 0-1 as bytes; what is beyond is clipped."""
    return np.asarray(np.clip(picture, 0.0, 1.0) * 255 + 0.5, np.uint8)


def render_points(
    viewer: View, points: FloatArray, colors: FloatArray, radius: int = 1
) -> RenderedLayer:
    """Render points (N, 3) with sRGB colours (N, 3) as squares of 2 ``radius`` + 1 px, the nearest
    on top.

    Of points at nearly the same distance, the last is on top.
    """
    import cv2

    width, height = viewer.size
    column, row, distance = viewer.project(points).T
    with np.errstate(invalid="ignore"):
        inside = (column > -0.5) & (column < width) & (row > -0.5) & (row < height) & (distance > 0)
    order = np.flatnonzero(inside)
    # The nearest come last. Steps of 16 bits are sorted in a tenth of the time, and alike by all
    # kernels of the CPU.
    nearer = distance[order].max(initial=0.0) - distance[order]
    steps = (65535 / max(nearer.max(initial=0.0), 1e-9) * nearer).astype(np.uint16)
    order = order[np.argsort(steps, kind="stable")]
    columns = np.minimum(np.round(column[order]), width - 1).astype(np.int64)
    rows = np.minimum(np.round(row[order]), height - 1).astype(np.int64)
    rank = np.zeros((height, width), np.float32)
    rank[rows, columns] = np.arange(1, len(order) + 1)  # numpy keeps the last of several writes
    rank = cv2.dilate(rank, np.ones((2 * radius + 1, 2 * radius + 1), np.uint8))
    drawn = rank > 0
    color = np.zeros((height, width, 3), np.float32)
    depth = np.full((height, width), np.inf, np.float32)
    point_of_pixel = order[rank[drawn].astype(np.int64) - 1]
    color[drawn] = colors[point_of_pixel]
    depth[drawn] = distance[point_of_pixel]
    return RenderedLayer(color, drawn.astype(np.float32), depth)


def _cast_rays(
    shapes: RayCaster, viewer: View, colors: Float64Array, columns: Float64Array, rows: Float64Array
) -> tuple[Float32Array, Float32Array]:
    """Cast rays (...); return colour and coverage (..., C + 1), 0 without a hit, and distance
    (...), inf there.
    """
    origins, directions = viewer.rays(columns.ravel(), rows.ravel())
    hits = shapes.first(origins, directions)
    hit = np.flatnonzero(hits.face >= 0)
    corners = shapes.faces[hits.face[hit]]
    weights = hits.barycentric[hit]
    base = np.einsum("nkc,nk->nc", colors[corners], weights)
    color = np.zeros((columns.size, colors.shape[1] + 1), np.float32)
    color[hit, :-1] = base
    color[hit, -1] = 1.0
    distance = np.full(columns.size, np.inf, np.float32)
    ahead = viewer.axes[2]
    distance[hit] = (origins[hit] - viewer.origin) @ ahead + hits.distance[hit] * (
        directions[hit] @ ahead
    )
    return color.reshape(*columns.shape, color.shape[1]), distance.reshape(columns.shape)


def shade(normals: Float64Array, axes: Float64Array, base: Float64Array) -> Float64Array:
    """Shade colours (N, 3) with a light from the upper left, one from above and darker silhouettes.

    Args:
        normals: (N, 3) unit.
        axes: of a view, see :class:`View`.
        base: sRGB in 0-1.
    """
    right, down, ahead = axes
    key = -ahead - 0.7 * down - 0.5 * right
    key /= np.linalg.norm(key)
    direct = np.clip(normals @ key, 0.0, 1.0)
    sky = 0.5 - 0.5 * (normals @ down)
    facing = np.clip(-(normals @ ahead), 0.0, 1.0)
    light = (0.34 + 0.52 * direct + 0.2 * sky) * (0.72 + 0.28 * facing**0.7)
    return np.asarray(np.clip(base * light[:, None], 0.0, 1.0))
