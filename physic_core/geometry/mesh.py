"""Normals and areas of the vertices of triangle meshes, as NumPy arrays or torch tensors, and
simplified meshes.

Torch is imported for tensors only, so that programs that only write files start fast.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import Tensor

    from physic_core.types import AnyArray, Float64Array

_Array = TypeVar("_Array", "NDArray[Any]", "Tensor")

_EQUAL_M = 1e-9  # smaller differences of distances are rounding errors


def vertex_normals(vertices: _Array, faces: _Array, around: Tensor | None = None) -> _Array:
    """Return outward unit vertex normals, weighted by face areas (faces counter-clockwise from
    outside).

    Args:
        vertices: (..., V, 3) of any unit.
        faces: (F, 3) integers, of the same library as ``vertices``.
        around: from :func:`faces_of_vertices`, for tensors of a mesh used repeatedly. A subset of
            its rows returns the normals of those vertices only, faster with the faces of
            :func:`faces_around_vertices`.

    Returns:
        (..., V, 3), or as many as ``around`` has rows, of tensors in their dtype, else float64;
        zero at a vertex without a face.
    """
    if isinstance(vertices, np.ndarray):
        total = _sum_at_corners_numpy(
            _doubled_areas_numpy(vertices, faces), faces, vertices.shape[-2]
        )
        length = np.linalg.norm(total, axis=-1, keepdims=True)
        normals: Float64Array = np.divide(total, length, out=np.zeros_like(total), where=length > 0)
        return normals
    import torch.nn.functional as F

    doubled = _doubled_areas(vertices, faces)
    if around is None:
        return F.normalize(_sum_at_corners(doubled, faces, vertices), dim=-1)
    padded = F.pad(doubled, (0, 0, 0, 1))
    # One gather for each column of the table: torch's sum of bags takes several times as long.
    first, *others = around.T
    total = padded.index_select(-2, first)
    for column in others:
        total = total + padded.index_select(-2, column)
    return F.normalize(total, dim=-1)


def vertex_areas(vertices: _Array, faces: _Array) -> _Array:
    """Return the area of each vertex: a third of the area of its faces.

    Args:
        vertices: (..., V, 3) of any unit.
        faces: (F, 3) integers, of the same library as ``vertices``.

    Returns:
        (..., V) in the square of the unit, of tensors in their dtype, else float64; their sum is
        the area of the mesh.
    """
    if isinstance(vertices, np.ndarray):
        sixth = np.linalg.norm(_doubled_areas_numpy(vertices, faces), axis=-1, keepdims=True) / 6.0
        return _sum_at_corners_numpy(sixth, faces, vertices.shape[-2])[..., 0]
    return _sum_at_corners(
        _doubled_areas(vertices, faces).norm(dim=-1, keepdim=True) / 6.0, faces, vertices
    )[..., 0]


def faces_of_vertices(faces: Tensor, count: int) -> Tensor:
    """Return the faces at each of ``count`` vertices: faces (F, 3) -> (count, largest number)
    int64, padded with F.
    """
    import torch

    corner = faces.reshape(-1)
    order = corner.argsort(stable=True)
    owner = corner[order]
    meeting = torch.bincount(corner, minlength=count)
    slot = torch.arange(len(owner)) - (meeting.cumsum(0) - meeting)[owner]
    table = torch.full((count, int(meeting.max())), len(faces), dtype=torch.int64)
    table[owner, slot] = order // 3
    return table


def faces_around_vertices(faces: Tensor, around: Tensor) -> tuple[Tensor, Tensor]:
    """Select the faces of some rows of a table of :func:`faces_of_vertices`.

    Args:
        faces: (F, 3) int64.
        around: (n, most) int64, padded with F.

    Returns:
        faces: (f, 3) int64, those in the table.
        around: (n, most) int64, the same table of these faces, padded with f.
    """
    used = faces.new_zeros(len(faces) + 1)
    used[around] = 1
    used[-1] = 0
    number = used.cumsum(0) - used
    return faces[used[:-1] > 0], number[around]


def _doubled_areas(vertices: Tensor, faces: Tensor) -> Tensor:
    """Return face normals (..., F, 3) of twice the faces' areas as length."""
    import torch

    a, b, c = (vertices.index_select(-2, faces[:, k]) for k in range(3))
    doubled: Tensor = torch.linalg.cross(b - a, c - a)
    return doubled


def _sum_at_corners(per_face: Tensor, faces: Tensor, vertices: Tensor) -> Tensor:
    """Sum face values (..., F, C) at the faces' corners: (..., V, C)."""
    import torch

    *lead, count, _ = vertices.shape
    columns = per_face.shape[-1]
    corners = (faces.T[..., None] * columns + torch.arange(columns)).flatten(1)
    bodies = [vertices.new_zeros(0)]
    # Along one axis: torch adds rows several times as slowly.
    for values in per_face.reshape(math.prod(lead), len(faces) * columns):
        total = vertices.new_zeros(count * columns)
        for corner in corners:
            total = total.index_add(0, corner, values)
        bodies.append(total)
    return torch.cat(bodies).reshape(*lead, count, columns)


def _doubled_areas_numpy(vertices: AnyArray, faces: AnyArray) -> Float64Array:
    a, b, c = (np.asarray(vertices, np.float64)[..., faces[:, k], :] for k in range(3))
    return np.cross(b - a, c - a)


def _sum_at_corners_numpy(per_face: Float64Array, faces: AnyArray, count: int) -> Float64Array:
    *lead, _, columns = per_face.shape
    total = np.empty((math.prod(lead), count, columns))
    corners = np.asarray(faces).T.reshape(-1)
    for body, values in zip(total, per_face.reshape(len(total), len(faces), columns), strict=True):
        for k in range(columns):
            body[:, k] = np.bincount(corners, np.tile(values[:, k], 3), count)
    return total.reshape(*lead, count, columns)


@dataclass(frozen=True)
class CoarseMesh:
    """A mesh on a subset of the vertices of a fine mesh.

    Attributes:
        ids: (v,) int64, vertices of the fine mesh.
        faces: (F, 3) int64 into ``ids``, oriented as in the fine mesh.
        of_vertex: (V,) int64 into ``ids``, representative of each vertex of the fine mesh.
    """

    ids: Tensor
    faces: Tensor
    of_vertex: Tensor


def coarse_mesh(
    vertices: Tensor, faces: Tensor, part_of_vertex: Tensor, spacing: float
) -> CoarseMesh:
    """Merge the vertices of each voxel and body part, and remove degenerate faces.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3) int64.
        part_of_vertex: (V,) int64; vertices of different parts are not merged.
        spacing: side of a cell, metres.
    """
    group, ids = cluster_points(vertices, part_of_vertex, spacing)
    a, b, c = group[faces].unbind(1)
    kept = (a != b) & (b != c) & (c != a)
    return CoarseMesh(ids, group[faces[kept]], group)


def cluster_points(points: Tensor, part_of_point: Tensor, spacing: float) -> tuple[Tensor, Tensor]:
    """Group points by voxel and part, and choose one point of each group.

    Args:
        points: (N, 3) metres.
        part_of_point: (N,) int64.
        spacing: side of a voxel, metres.

    Returns:
        group: (N,) int64, group of each point.
        chosen: (G,) int64, the point nearest to the centroid of each group.
    """
    import torch

    if not len(points):
        return part_of_point, part_of_point
    points = points.double()
    cell = (points / spacing).floor().long()
    # One integer key for cell and part: unique rows take ten times as long.
    x, y, z = (cell - cell.amin(0)).unbind(1)
    wide = int(cell.amax() - cell.amin()) + 1
    parts = int(part_of_point.max()) + 1
    keys, group = torch.unique(
        ((x * wide + y) * wide + z) * parts + part_of_point, return_inverse=True
    )
    count = len(keys)
    centre = (
        points.new_zeros(count, 3).index_add(0, group, points)
        / torch.bincount(group, minlength=count)[:, None]
    )
    distance = (points - centre[group]).norm(dim=-1)
    least = distance.new_full((count,), torch.inf).scatter_reduce(0, group, distance, "amin")
    best = (distance <= least[group] + _EQUAL_M).nonzero(as_tuple=True)[0]
    # Ties, as in every group of two, go to the first point.
    chosen = best.new_full((count,), len(points)).scatter_reduce(0, group[best], best, "amin")
    return group, chosen
