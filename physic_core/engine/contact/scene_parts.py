"""Parts of the scene that bodies touch: semantic class and connected surface of the scene points
near people.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from torch import Tensor

GROUND_CLASSES = ("floor", "ground", "rug")
"""Classes of :data:`physic_core.types.SURFACE_NAMES` that are the floor."""

UPRIGHT_CLASSES = ("wall", "ceiling", "window")
"""Classes of surfaces on which nothing rests."""

_NO_SURFACE = ("unknown", "person", "sky")
# such a label is wrong where a point faces up under a sole
_CARRIES_NOBODY = (*UPRIGHT_CLASSES, "water")
# least cosine between up and the normal of a point that is not a wall, for any label
_FACES_UP = 0.3
_NEIGHBOUR_M = 0.5  # within which a visible point gives its class to a hidden one
_RAISED_M = 0.10  # over the floor, above which a hidden point is not the floor
_CELL_M = 0.04  # of the grid in which the points are joined to surfaces
_SAME_SURFACE_COSINE = 0.8  # 37 degrees between normals of one surface without a class


@dataclass(frozen=True)
class ClassifiedPoints:
    """Semantic classes of M scene points.

    Attributes:
        names: of the classes, as in :class:`physic_core.types.SurfaceLabels`.
        label: (M,) int64, index into ``names``.
        seen: (M,) bool, points that the photo shows; the others are inpainted, and their label is
            ignored.
    """

    names: tuple[str, ...]
    label: Tensor
    seen: Tensor


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


def scene_parts(
    points: Tensor,
    normals: Tensor,
    row: Tensor,
    classes: ClassifiedPoints,
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
        points: (n, 3) metres.
        normals: (n, 3) unit; zero where unknown.
        row: (n,) int64, row of each point in ``classes``; -1 for samples of the floor.
        classes: of all scene points.
        height: (n,) of the points above the floor, metres, or None.
        up: (3,) unit.
    """
    names = classes.names
    raised = (
        torch.zeros(len(points), dtype=torch.bool) if height is None else height.cpu() > _RAISED_M
    )
    label = _labels(points, row, classes, raised)
    mistaken = _among(label, names, _CARRIES_NOBODY) & (
        (normals @ up.to(normals)).cpu() > _FACES_UP
    )
    label[mistaken] = -1
    ground = row.cpu() < 0
    ground = ground | (_among(label, names, GROUND_CLASSES) & ~raised)
    if height is not None:
        off = height.cpu().abs()
        ground = ground | (off < _CELL_M) | (mistaken & (off < _RAISED_M))
    surface = _connected(
        points.cpu().double().numpy(), normals.cpu().double().numpy(), label.numpy(), ground.numpy()
    )
    at = points.device
    return SceneParts(names, label.to(at), torch.from_numpy(surface).to(at), ground.to(at))


def _labels(points: Tensor, row: Tensor, classes: ClassifiedPoints, raised: Tensor) -> Tensor:
    """Return the label (n,) of each point on the CPU; -1 where it is unknown."""
    label = torch.full((len(points),), -1, dtype=torch.int64)
    if not len(points):
        return label
    row = row.cpu()
    given = torch.where(row >= 0, classes.label.cpu()[row], 0)
    floors = _among(given, classes.names, GROUND_CLASSES)
    seen = (row >= 0) & classes.seen.cpu()[row] & ~_among(given, classes.names, _NO_SURFACE)
    label[seen] = given[seen]
    at = points.cpu().double().numpy()
    for hidden, source in ((~seen & ~raised, seen), (~seen & raised, seen & ~floors)):
        if bool(hidden.any()) and bool(source.any()):
            distance, index = cKDTree(
                at[source.numpy()], balanced_tree=False, compact_nodes=False
            ).query(at[hidden.numpy()], distance_upper_bound=_NEIGHBOUR_M)
            found = torch.from_numpy(np.isfinite(distance))
            near = torch.from_numpy(np.where(np.isfinite(distance), index, 0))
            label[hidden] = torch.where(found, given[source][near], -1)
    return label


def _among(label: Tensor, names: tuple[str, ...], chosen: tuple[str, ...]) -> Tensor:
    """Return which labels (n,) bool have one of the chosen names."""
    return torch.isin(
        label,
        torch.tensor([names.index(name) for name in chosen if name in names], dtype=label.dtype),
    )


def _connected(
    points: np.ndarray, normals: np.ndarray, label: np.ndarray, ground: np.ndarray
) -> np.ndarray:
    """Return the connected surface (n,) of each point; the floor is one surface."""
    if not len(points):
        return np.zeros(0, np.int64)
    group = np.where(ground, -2, label)
    at = np.floor(points / _CELL_M).astype(np.int64)
    x, y, z = (at - at.min(axis=0)).T
    wide = int(np.ptp(at, axis=0).max()) + 1
    groups = int(group.max()) + 3
    # Cells of one class are joined; without a class, cells whose normals agree. Unique rows take
    # ten times as long.
    number = ((x * wide + y) * wide + z) * groups + group + 2
    _, first, cell = np.unique(number, return_index=True, return_inverse=True)
    pairs = cKDTree(points[first]).query_pairs(2 * _CELL_M, output_type="ndarray")
    a = first[pairs[:, 0]]
    b = first[pairs[:, 1]]
    agree = (normals[a] * normals[b]).sum(1) > _SAME_SURFACE_COSINE
    joined = (group[a] == group[b]) & (agree | (group[a] != -1))
    pairs = pairs[joined]
    count = len(first)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, component = connected_components(graph, directed=False)
    surface = component[cell].astype(np.int64)
    surface[ground] = -1
    _, surface = np.unique(surface, return_inverse=True)
    return surface.reshape(-1).astype(np.int64)
