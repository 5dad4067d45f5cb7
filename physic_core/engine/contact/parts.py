"""Parts of the scene near people, by semantic class and connected surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from torch import Tensor

from physic_core.geometry.neighbors import NearestPointSearch, nearest_indices, search_tree
from physic_core.geometry.tensors import exact_arrays
from physic_core.types.people import GROUND_SURFACES

UPRIGHT_CLASSES = ("wall", "ceiling", "window")
"""Classes of surfaces on which nothing rests."""

SAT_ON = ("seat", "bed", "stairs", "vehicle")
"""Classes of surfaces above the floor on which people sit; others below them are seats."""

_CELL_M = 0.04  # side of the cells in which points are joined to surfaces


@dataclass(frozen=True)
class SceneParts:
    """Class and connected surface of n scene points near people.

    Attributes:
        names: of the classes.
        label: (n,) int64, index into ``names``; -1 where the class is unknown.
        surface: (n,) int64, id of the connected surface, counted from 0.
        ground: (n,) bool, points of the floor.
    """

    names: tuple[str, ...]
    label: Tensor
    surface: Tensor
    ground: Tensor


FACES_UP = 0.3
"""Least cosine between up and a normal that faces up: of points that are no wall, of skin that
carries. Normals that face down have less than its negative.
"""
# Such a label is wrong where a point faces up under a sole.
_CARRIES_NOBODY = (*UPRIGHT_CLASSES, "water")
_RAISED_M = 0.10  # height over the floor above which a hidden point is not the floor


def scene_parts(
    scene: NearestPointSearch,
    row: Tensor,
    names: tuple[str, ...],
    labels: Tensor,
    height: Tensor | None,
    up: Tensor,
) -> SceneParts:
    """Find class and connected surface of scene points.

    A hidden point has the class of the nearest visible one, within half a metre. A hidden point
    more than 10 cm above the floor is not floor. Points of any class within 4 cm of its plane are
    floor: labels around feet follow the appearance of the feet. A point that faces up is not a
    wall, and no one stands on water: with such a label, it is floor within 10 cm of the plane, and
    its class is unknown elsewhere. Points of one class are one surface if they are connected by
    steps of less than two cells of 4 cm. Without a class, their normals also agree within 37
    degrees.

    Args:
        scene: n points, metres, with their normals; zero where unknown.
        row: (n,) int64, row of each point in ``labels``; -1 for samples of the floor.
        names: of the classes, as in :class:`physic_core.types.SurfaceLabels`.
        labels: (M,) int64 of all scene points, index into ``names``; -1 of inpainted points.
        height: (n,) of the points above the floor, metres, or None.
        up: (3,) unit.
    """
    points = scene.points
    normals = scene.normals
    raised = torch.zeros(len(points), dtype=torch.bool) if height is None else height > _RAISED_M
    label = _surface_label_of_points(points, row, names, labels, raised)
    mistaken = _has_label(label, names, _CARRIES_NOBODY) & ((normals @ up.to(normals)) > FACES_UP)
    label[mistaken] = -1
    ground = row < 0
    ground = ground | (_has_label(label, names, GROUND_SURFACES) & ~raised)
    if height is not None:
        floor_distance = height.abs()
        ground = ground | (floor_distance < _CELL_M) | (mistaken & (floor_distance < _RAISED_M))
    surface = torch.from_numpy(_connected_surfaces(*exact_arrays(points, normals, label, ground)))
    return SceneParts(names, label, surface, ground)


_NO_SURFACE = ("unknown", "person", "sky")
_NEIGHBOUR_M = 0.5  # reach in which a visible point gives its class to a hidden one


def _surface_label_of_points(
    points: Tensor, row: Tensor, names: tuple[str, ...], labels: Tensor, raised: Tensor
) -> Tensor:
    """Return the label (n,) of each point; -1 where it is unknown."""
    label = torch.full((len(points),), -1, dtype=torch.int64)
    if not len(points):
        return label
    named = torch.where(row >= 0, labels[row], -1)
    floors = _has_label(named, names, GROUND_SURFACES)
    is_surface = (named >= 0) & ~_has_label(named, names, _NO_SURFACE)
    label[is_surface] = named[is_surface]
    for hidden, source in (
        (~is_surface & ~raised, is_surface),
        (~is_surface & raised, is_surface & ~floors),
    ):
        if hidden.any() and source.any():
            tree = search_tree(points[source])
            nearest, away = nearest_indices(tree, points[hidden], _NEIGHBOUR_M)
            label[hidden] = torch.where(away.isfinite(), named[source][nearest], -1)
    return label


def _has_label(label: Tensor, names: tuple[str, ...], chosen: tuple[str, ...]) -> Tensor:
    """Return which labels (n,) bool have one of the chosen names."""
    return torch.isin(
        label,
        torch.tensor([names.index(name) for name in chosen if name in names], dtype=label.dtype),
    )


_SAME_SURFACE_COSINE = 0.8  # 37 degrees between normals of one surface without a class


def _connected_surfaces(
    points: np.ndarray, normals: np.ndarray, label: np.ndarray, ground: np.ndarray
) -> np.ndarray:
    """Return the connected surface (n,) of each point; the floor is one surface."""
    if not len(points):
        return np.zeros(0, np.int64)
    group = np.where(ground, -2, label)
    cells = np.floor(points / _CELL_M).astype(np.int64)
    x, y, z = (cells - cells.min(axis=0)).T
    wide = int(np.ptp(cells, axis=0).max()) + 1
    groups = int(group.max()) + 3
    # Cells of one class are joined; without a class, cells whose normals agree. Unique rows take
    # ten times as long.
    number = ((x * wide + y) * wide + z) * groups + group + 2
    _, first_point, cell = np.unique(number, return_index=True, return_inverse=True)
    pairs = cKDTree(points[first_point]).query_pairs(2 * _CELL_M, output_type="ndarray")
    a = first_point[pairs[:, 0]]
    b = first_point[pairs[:, 1]]
    agree = (normals[a] * normals[b]).sum(1) > _SAME_SURFACE_COSINE
    joined = (group[a] == group[b]) & (agree | (group[a] != -1))
    pairs = pairs[joined]
    count = len(first_point)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, component = connected_components(graph, directed=False)
    surface = component[cell].astype(np.int64)
    surface[ground] = -1
    _, surface = np.unique(surface, return_inverse=True)
    return surface.reshape(-1).astype(np.int64)
