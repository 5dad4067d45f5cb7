"""Visibility of body vertices in the photo, and free space in front of the scene.

A vertex is visible by its facing angle, masks, and occlusion by limbs or other people.

A point in front of all surfaces of a depth map is in free space. Beyond the rim of a surface, the
normal of the nearest scene point does not distinguish inside from outside. For example, a calf in
front of a seat is below the seat's plane, but not inside the seat.

Camera frame (x right, y down, z forward), metres; the camera is the origin. Pixels have integer
centres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from physic_core.geometry.rays import RayCaster
from physic_core.geometry.tensors import exact_arrays

if TYPE_CHECKING:
    from physic_core.geometry.mesh import CoarseMesh
    from physic_core.types import Float64Array, Int64Array

# Least distance of a surface in front of a vertex that hides it: a smaller gap is rounding error.
_BEHIND_M = 2e-3

FACING_DEG = 70.0
"""Largest angle between the normal of a vertex and the direction to the camera, at which the photo
shows it well: vertices beyond lie at the rim, where one pixel of the mask decides.
"""

_STEP_M = 1e-4  # beyond a face, so that the next ray does not hit it again


def facing_camera(normals: Tensor, vertices: Tensor, max_angle_deg: float) -> Tensor:
    """Return whether vertex normals are within an angle of the direction to the camera: (...) bool.

    Section 3.2 of the paper.

    Args:
        normals: (..., 3) unit.
        vertices: (..., 3) metres, camera frame.
        max_angle_deg: largest angle; 90 takes all vertices that face the camera.
    """
    towards = -F.normalize(vertices, dim=-1)
    return (normals * towards).sum(-1) > math.cos(math.radians(max_angle_deg))


def inside_image(uv: Tensor, height: int, width: int) -> Tensor:
    """Return whether pixel coordinates (..., 2) round to a pixel of the image; False for NaN: (...)
    bool.
    """
    u = uv[..., 0]
    v = uv[..., 1]
    return (u >= -0.5) & (u < width - 0.5) & (v >= -0.5) & (v < height - 0.5)


def inside_mask(uv: Tensor, mask: Tensor) -> Tensor:
    """Return whether the mask is set at pixel coordinates; False outside the image: (..., V) bool.

    Args:
        uv: (..., V, 2) px.
        mask: (..., H, W) bool, with the leading dimensions of ``uv``.
    """
    height, width = mask.shape[-2:]
    inside = inside_image(uv, height, width)
    safe = torch.where(inside[..., None], uv, 0.0).round().long()
    flat = safe[..., 1] * width + safe[..., 0]
    return torch.gather(mask.flatten(-2), -1, flat) & inside


def hidden_from_camera(vertices: Tensor, faces: Tensor) -> tuple[Tensor, Tensor]:
    """Return which vertices are behind another face of their own mesh.

    Args:
        vertices: (..., V, 3) metres, camera frame.
        faces: (F, 3) int64, of a closed surface, counter-clockwise seen from outside.

    Returns:
        hidden: (..., V) bool.
        face: (..., V) int64, the face in front of a hidden vertex; -1 for the others.
    """
    shape = vertices.shape[:-1]
    people, triangles = exact_arrays(vertices.reshape(-1, *vertices.shape[-2:]), faces)
    in_front = np.stack([_faces_in_front(body, triangles) for body in people])
    face = torch.from_numpy(in_front).reshape(shape)
    return face >= 0, face


def _faces_in_front(points: Float64Array, triangles: Int64Array) -> Int64Array:
    """Return the face in front of each vertex of a mesh, (V,); -1 for visible ones."""
    distance = np.linalg.norm(points, axis=1)
    rays = points / np.maximum(distance, 1e-9)[:, None]
    # Only faces that face the camera can be hit first: the others are excluded from the search
    # tree.
    start = points[triangles[:, 0]]
    normals = np.cross(points[triangles[:, 1]] - start, points[triangles[:, 2]] - start)
    front = np.flatnonzero((normals * start).sum(1) < 0)
    if not len(front):
        return np.full(len(points), -1)
    caster = RayCaster(points, triangles[front])
    hit = caster.first_faces(np.zeros(3), rays)
    nearer = caster.plane_distance(hit, np.zeros_like(rays), rays)
    face = front[hit]
    own = (triangles[face] == np.arange(len(points))[:, None]).any(1)
    return np.where((hit >= 0) & ~own & (nearer < distance - _BEHIND_M), face, -1)


def self_occlusion(
    vertices: Tensor,
    faces: Tensor,
    part_of_vertex: Tensor,
    parts: Sequence[int],
    share: float,
    coarse: CoarseMesh | None = None,
) -> tuple[Tensor, Tensor]:
    """Find body parts that other parts of the same body hide from the camera (paper sec. 3.3).

    Args:
        vertices: (..., V, 3) metres, camera frame.
        faces: (F, 3) int64, of a closed surface.
        part_of_vertex: (V,) int64.
        parts: parts that can become occluded; the paper and its code take the limbs, not trunk and
            head.
        share: least share of a part's vertices hidden by other parts.
        coarse: simplified mesh of the same body; its vertices are tested instead, several times as
            fast.

    Returns:
        hidden: (..., V) bool, vertices behind any face of the same body.
        of_hidden_parts: (..., V) bool, all vertices of the occluded parts.
    """
    if coarse is None:
        hidden, face = hidden_from_camera(vertices, faces)
        in_front = part_of_vertex[faces[face.clamp(min=0), 0]]
    else:
        hidden, face = hidden_from_camera(vertices.index_select(-2, coarse.ids), coarse.faces)
        in_front = part_of_vertex[coarse.ids[coarse.faces[face.clamp(min=0), 0]]]
        hidden, in_front = (
            flags.index_select(-1, coarse.of_vertex) for flags in (hidden, in_front)
        )
    by_other = hidden & (in_front != part_of_vertex)
    count = max(int(part_of_vertex.max()) + 1, max(parts, default=-1) + 1)
    total = torch.bincount(part_of_vertex, minlength=count)
    occluded_area = total.new_zeros(*by_other.shape[:-1], count).index_add(
        -1, part_of_vertex, by_other.to(total.dtype)
    )
    eligible = torch.zeros(count, dtype=torch.bool)
    eligible[list(parts)] = True
    occluded = eligible & (occluded_area >= share * total) & (total > 0)
    return hidden, occluded[..., part_of_vertex]


def front_depth(depth: Tensor) -> Tensor:
    """Return the least depth of each 2 x 2 pixel block: (H, W) -> (H - 1, W - 1); inf if none is
    finite.

    Four pixels, since at a depth edge a single one may show the background.
    """
    filled = torch.where(torch.isfinite(depth), depth, torch.inf)
    rows = torch.minimum(filled[:-1], filled[1:])
    return torch.minimum(rows[:, :-1], rows[:, 1:])


def in_free_space(points: Tensor, front: Tensor, K: Tensor) -> Tensor:
    """Return whether each point (..., 3) lies in front of every surface of the depth map: (...)
    bool.

    Args:
        points: camera frame, in the unit of ``front``.
        front: (H - 1, W - 1), from :func:`front_depth`.
        K: (3, 3) px of the full image. Points outside the image or behind the camera are in free
            space.
    """
    K = K.to(points)
    z = points[..., 2]
    ahead = z > 1e-6
    away = torch.where(ahead, z, 1.0)
    column = (K[0, 0] * points[..., 0] / away + K[0, 2]).floor()
    row = (K[1, 1] * points[..., 1] / away + K[1, 2]).floor()
    height, width = front.shape
    inside = ahead & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    flat = torch.where(inside, row * width + column, 0).long()
    return ~(inside & (front.flatten()[flat] < z))


_Array = NDArray[np.float64]

_ROUNDS = 3  # a point that leaves one limb may enter another


def move_out_of_bodies(
    points: Tensor, bodies: Tensor, faces: Tensor, shown: Tensor, reach: float
) -> tuple[Tensor, Tensor]:
    """Move scene points (N, 3) out of bodies, and behind bodies that are visible at their pixels.

    A point that would move farther than ``reach`` does not move: then body or scene is wrong.

    Args:
        points: (N, 3).
        bodies: (B, V, 3), finite.
        faces: (F, 3) int64, of a closed surface, counter-clockwise seen from outside.
        shown: (B, N) bool, whether the body is visible at the point's pixel.
        reach: metres.

    Returns:
        points: (N, 3), moved.
        moved: (N,) bool.
    """
    start, triangles, people, visible = exact_arrays(points, faces, bodies, shown)
    rays = start / np.maximum(np.linalg.norm(start, axis=1), 1e-9)[:, None]
    along = np.zeros(len(start))
    if not len(start):
        return points, torch.zeros(0, dtype=torch.bool)
    casters = [RayCaster(body, triangles) for body in people]
    for caster, is_candidate in zip(casters, visible, strict=True):
        along[is_candidate] = np.maximum(
            along[is_candidate],
            _distance_to_front_face(caster, start[is_candidate], rays[is_candidate], reach),
        )
    moving = np.arange(len(start))
    origins = np.ascontiguousarray(start.T)
    ways = np.ascontiguousarray(rays.T)
    for _ in range(_ROUNDS):
        before = along[moving]
        for caster in casters:
            there, near = _inside_box(caster, origins, ways, along, moving)
            along[near] += _distance_to_exit(caster, there, rays[near])
        moving = moving[along[moving] != before]
        if not len(moving):
            break
    along = np.where(along <= reach, along, 0.0)
    moved, out = (torch.from_numpy(each) for each in (start + along[:, None] * rays, along > 0))
    return torch.where(out[:, None], moved.to(points), points), out


def _distance_to_front_face(
    caster: RayCaster, points: _Array, rays: _Array, reach: float
) -> _Array:
    """Return the distance from each point to the front face behind it on its ray; 0 for others."""
    face = caster.first_faces(np.zeros(3), rays)
    front = (face >= 0) & ((caster.normals[face] * rays).sum(1) < 0)
    way = caster.plane_distance(face, np.zeros_like(rays), rays) - np.linalg.norm(points, axis=1)
    return np.where(front & (way > 0) & (way <= reach), way + _STEP_M, 0.0)


def _inside_box(
    caster: RayCaster, origins: _Array, ways: _Array, along: _Array, candidates: Int64Array
) -> tuple[_Array, Int64Array]:
    """Return the places (k, 3) on rays inside the box of a mesh, and their columns (k,).

    Args:
        caster: of the mesh.
        origins: (3, N).
        ways: (3, N).
        along: (N,) distance of the place from the origin, in lengths of the way.
        candidates: (n,) columns that are looked at.
    """
    positions = list[_Array]()
    # By axes, z first: it excludes most places, and one axis is cheaper than three.
    for axis in (2, 1, 0):
        position = origins[axis, candidates] + along[candidates] * ways[axis, candidates]
        inside = (position > caster.low[axis]) & (position < caster.high[axis])
        candidates = candidates[inside]
        positions = [position[inside], *(other[inside] for other in positions)]
    return np.stack(positions, 1), candidates


def _distance_to_exit(caster: RayCaster, points: _Array, rays: _Array) -> _Array:
    """Return the distance from each inside point along its ray to the surface; 0 for outside
    points.
    """
    way = np.zeros(len(points))
    face = caster.first_faces(points, rays)
    near = np.flatnonzero(face >= 0)
    face = face[near]
    distance = caster.plane_distance(face, points[near], rays[near])
    from_within = ((caster.normals[face] * rays[near]).sum(1) > 0) & (distance > 0)
    way[near[from_within]] = distance[from_within] + _STEP_M
    return way
