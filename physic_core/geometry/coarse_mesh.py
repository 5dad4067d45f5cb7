"""Simplify a mesh: one vertex for each cell of a voxel grid and body part."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

_EQUAL_M = 1e-9  # smaller differences of distances are rounding errors


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

    def to(self, device: torch.device) -> CoarseMesh:
        """Return a copy on another device."""
        return CoarseMesh(self.ids.to(device), self.faces.to(device), self.of_vertex.to(device))


def coarse_mesh(vertices: Tensor, faces: Tensor, part_of_vertex: Tensor, spacing: float) -> CoarseMesh:
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
    points = points.double()
    cell = (points / spacing).floor().long()
    # One integer key for cell and part: unique rows take ten times as long.
    x, y, z = (cell - cell.amin(0)).unbind(1) if len(points) else cell.unbind(1)
    wide = int(cell.amax() - cell.amin()) + 1 if len(points) else 1
    parts = int(part_of_point.max()) + 1 if len(points) else 1
    _, group = torch.unique(((x * wide + y) * wide + z) * parts + part_of_point, return_inverse=True)
    count = int(group.max()) + 1 if len(group) else 0
    centre = points.new_zeros(count, 3).index_add(0, group, points) / torch.bincount(group, minlength=count)[:, None]
    off = (points - centre[group]).norm(dim=-1)
    least = off.new_full((count,), torch.inf).scatter_reduce(0, group, off, "amin")
    best = (off <= least[group] + _EQUAL_M).nonzero(as_tuple=True)[0]
    # Ties, as in every group of two, go to the first point.
    chosen = best.new_full((count,), len(points)).scatter_reduce(0, group[best], best, "amin")
    return group, chosen
