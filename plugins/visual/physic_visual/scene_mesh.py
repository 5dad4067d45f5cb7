"""Triangle meshes of a result: the scene from its point map, and a backdrop of what is farther;
normals of vertices.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from physic_core.geometry import vertex_normals

if TYPE_CHECKING:
    from physic_core.types import (
        AnyArray,
        BoolArray,
        Float32Array,
        FloatArray,
        Int64Array,
        IntArray,
        Reconstruction,
        Scene,
    )

_MAX_VERTICES = 130_000
"""Maximum number of vertices; its GLB then stays under 5 MB, at 32 bytes a vertex with two
triangles.
"""

_MAX_DEPTH_RATIO = 1.06
"""Maximum depth ratio of neighbours on one surface; 1.03-1.1 works."""

_MAX_SLANTED_DEPTH_RATIO = 1.2
"""Maximum depth ratio of neighbours on a slanted surface (such as a distant floor), by their
normals.
"""

_MIN_COMPONENT_SHARE = 0.002
"""Minimum size of a connected component, as a share of all vertices."""

BACKDROP = "direction only, distance unknown"
"""What files and pages say of the backdrop."""

_SHELL_CELLS = 160
"""Squares of the backdrop along the photo's longer side."""

_LEAST_CELL_PX = 4

_CRACK = 0.02
"""Width of the cracks at edges in depth, which the backdrop does not fill, as a share of the
photo's longer side.
"""

_ACROSS = 0.15  # sine of the angle between the step and the surface: up to 9 degrees is along it


_Made = TypeVar("_Made")


def cached_for_last_result(
    make: Callable[[Reconstruction], _Made],
) -> Callable[[Reconstruction], _Made]:
    """Keep what is made of the last result, for its preview, GLB and page; threads that draw them
    share it.
    """
    last: list[tuple[weakref.ref[Reconstruction], _Made]] = []
    making = Lock()

    @wraps(make)
    def kept(result: Reconstruction) -> _Made:
        with making:
            if not last or last[0][0]() is not result:
                last[:] = [(weakref.ref(result), make(result))]
            return last[0][1]

    return kept


@dataclass(frozen=True)
class SceneMesh:
    """Triangle mesh with a pixel for each vertex.

    Attributes:
        vertices: (V, 3) float32 metres, camera frame.
        faces: (F, 3) int64, counter-clockwise as seen from the camera.
        pixels: (V, 2) int64, column and row of each vertex.
        stride: px between neighbours; 1 of the backdrop.
    """

    vertices: Float32Array
    faces: Int64Array
    pixels: Int64Array
    stride: int = 1


def scene_reach(reconstruction: Reconstruction) -> float:
    """Return the distance from the camera at which the scene mesh ends and the backdrop lies,
    metres.

    It is three times the depth of the farthest person, at least 8 m.
    """
    depths = [float(np.median(person.vertices[:, 2])) for person in reconstruction.people]
    finite = [depth for depth in depths if math.isfinite(depth)]
    return max(8.0, 3.0 * max(finite)) if finite else 20.0


@cached_for_last_result
def scene_meshes(result: Reconstruction) -> tuple[SceneMesh, SceneMesh]:
    """Return the scene mesh and the backdrop of a result, see :func:`mesh_scene` and
    :func:`mesh_backdrop`.
    """
    surface = mesh_scene(result.scene, scene_reach(result))
    return surface, mesh_backdrop(result, surface)


def mesh_scene(scene: Scene, limit: float, max_vertices: int = _MAX_VERTICES) -> SceneMesh:
    """Build a triangle mesh of every n-th pixel of a scene; faces join neighbours on the same
    surface.

    Args:
        scene: point map of (H, W) pixels.
        limit: distance from the camera in metres beyond which pixels are skipped.
        max_vertices: upper limit of the number of vertices, which determines n.
    """
    height, width = scene.valid.shape
    stride = max(1, math.ceil(math.sqrt(height * width / max_vertices)))
    rows = np.arange(0, height, stride)
    columns = np.arange(0, width, stride)
    grid = np.ix_(rows, columns)
    points = np.asarray(scene.points[grid], np.float32)
    normals = np.asarray(scene.normals[grid], np.float32)
    usable = scene.valid[grid] & is_near(points, limit)
    points = np.where(usable[..., None], points, 1.0)
    faces = _remove_small_components(_surface_faces(points, normals, usable), usable.size)
    used = np.zeros(usable.size, bool)
    used[faces] = True
    new_ids = np.cumsum(used) - 1
    pixels = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2)
    return SceneMesh(points.reshape(-1, 3)[used], new_ids[faces], pixels[used], stride)


def _surface_faces(points: AnyArray, normals: AnyArray, usable: BoolArray) -> Int64Array:
    """Return triangles (F, 3) of usable points (H, W, 3) that are neighbours on one surface."""

    def joined(first: Any, second: Any) -> BoolArray:
        same = _on_same_surface(points, normals, first, second)
        return np.asarray(usable[first] & usable[second] & same)

    across = joined(np.s_[:, :-1], np.s_[:, 1:])
    along = joined(np.s_[:-1], np.s_[1:])
    diagonal = joined(np.s_[1:, :-1], np.s_[:-1, 1:])
    upper = across[:-1] & along[:, :-1] & diagonal
    lower = across[1:] & along[:, 1:] & diagonal
    return _halves(np.arange(usable.size).reshape(usable.shape), upper, lower)


def _halves(ids: Int64Array, upper: BoolArray, lower: BoolArray) -> Int64Array:
    """Return the triangles (F, 3) of the chosen upper and lower halves of a grid's squares."""
    first = np.stack([ids[:-1, :-1], ids[1:, :-1], ids[:-1, 1:]], -1)
    second = np.stack([ids[:-1, 1:], ids[1:, :-1], ids[1:, 1:]], -1)
    return np.concatenate([first[upper], second[lower]])


def is_near(points: FloatArray, limit: float) -> BoolArray:
    """Return which points (..., 3) are finite, before the camera, and nearer to it than a limit in
    metres.
    """
    x, y, z = (points[..., axis] for axis in range(3))
    with np.errstate(invalid="ignore", over="ignore"):
        return (z > 0) & (x * x + y * y + z * z < limit * limit)


def mesh_backdrop(result: Reconstruction, surface: SceneMesh) -> SceneMesh:
    """Build a mesh of what is farther than the scene mesh or at no known distance: only its
    direction is known.

    It is a part of the sphere around the camera with the radius :func:`scene_reach`, faces the
    camera, and reaches a little behind the edge of the scene mesh. It has no faces where the scene
    mesh fills the photo.

    Args:
        result: of the photo.
        surface: its scene mesh.
    """
    import cv2

    height, width = result.scene.valid.shape
    cell = max(_LEAST_CELL_PX, max(height, width) / _SHELL_CELLS)
    cells = max(1, round(width / cell)), max(1, round(height / cell))
    far = _far_pixels(surface, (height, width)).astype(np.float32)
    is_far_cell = cv2.resize(far, cells, interpolation=cv2.INTER_AREA) > 0.5
    columns, rows = (
        np.linspace(0, size - 1, count + 1)
        for size, count in zip((width, height), cells, strict=True)
    )
    ids = np.arange(len(rows) * len(columns)).reshape(len(rows), len(columns))
    faces = _halves(ids, is_far_cell, is_far_cell)
    spots = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2)
    used = np.unique(faces)
    pixels = np.round(spots[used]).astype(np.int64)
    camera = result.intrinsics
    rays = np.c_[(pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy], np.ones(len(used))]
    vertices = scene_reach(result) * rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return SceneMesh(vertices.astype(np.float32), np.searchsorted(used, faces), pixels)


def _far_pixels(surface: SceneMesh, size: tuple[int, int]) -> IntArray:
    """Return pixels (H, W), 1 where the photo shows what is not on a surface, and a little
    beyond.
    """
    import cv2

    covered = np.zeros(size, np.uint8)
    covered[surface.pixels[:, 1], surface.pixels[:, 0]] = 1
    crack = np.ones((max(3, round(_CRACK * max(size))),) * 2, np.uint8)
    far = 1 - cv2.dilate(covered, np.ones((2 * surface.stride + 1,) * 2, np.uint8))
    far = cv2.morphologyEx(far, cv2.MORPH_OPEN, crack, borderType=cv2.BORDER_REPLICATE)
    _, piece, boxes, _ = cv2.connectedComponentsWithStats(far)
    far[boxes[piece, cv2.CC_STAT_AREA] < _MIN_COMPONENT_SHARE * far.size] = 0
    return np.asarray(cv2.dilate(far, crack))


def _remove_small_components(faces: Int64Array, count: int) -> Int64Array:
    """Remove small connected components, which come from flying pixels."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = coo_array((np.ones(len(links), bool), (links[:, 0], links[:, 1])), shape=(count, count))
    _, piece = connected_components(graph, directed=False)
    sizes = np.bincount(piece)
    joined = sizes[sizes > 1].sum()
    kept: Int64Array = faces[sizes[piece[faces[:, 0]]] > _MIN_COMPONENT_SHARE * joined]
    return kept


def _on_same_surface(points: AnyArray, normals: AnyArray, first: Any, second: Any) -> BoolArray:
    depth = points[..., 2]
    near = np.minimum(depth[first], depth[second])
    far = np.maximum(depth[first], depth[second])
    # By columns: sums over an axis of three take several times as long.
    x, y, z = (points[second][..., k] - points[first][..., k] for k in range(3))
    reach = _ACROSS * np.sqrt(x * x + y * y + z * z)
    flat = np.ones(reach.shape, bool)
    for normal in (normals[first], normals[second]):
        u, v, w = (normal[..., k] for k in range(3))
        # A normal of zero is unknown, and must not vouch for a steep step.
        flat &= (np.abs(u * x + v * y + w * z) < reach) & ((u != 0) | (v != 0) | (w != 0))
    return np.asarray(
        (far < _MAX_DEPTH_RATIO * near) | (flat & (far < _MAX_SLANTED_DEPTH_RATIO * near))
    )


def unit_normals(vertices: FloatArray, faces: IntArray) -> Float32Array:
    """Return vertex normals (V, 3) of a mesh for files that demand unit vectors: +z at a vertex
    without a face.
    """
    normals = vertex_normals(vertices, faces)
    normals[~normals.any(1)] = 0.0, 0.0, 1.0
    return normals.astype(np.float32)
