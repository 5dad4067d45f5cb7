"""Nearest scene point of each body vertex within a search radius, by an exact k-d tree.

To query a scene scaled by a factor, the vertices are divided by it, so that the tree stays valid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
import torch
from scipy.spatial import cKDTree

from physic_core.geometry.tensors import exact_arrays

if TYPE_CHECKING:
    from torch import Tensor

array_tree = partial(cKDTree, leafsize=32, balanced_tree=False, compact_nodes=False)
"""k-d tree of an array (M, 3) float64.

For pixel samples and skins, and a bounded distance, it is built faster and searched up to three
times as fast as SciPy's default.
"""


def search_tree(points: Tensor) -> cKDTree:
    """Return a k-d tree of points (M, 3), on the CPU and in float64."""
    return array_tree(*exact_arrays(points))


def nearest_indices(
    tree: cKDTree, places: Tensor, radius: float = math.inf
) -> tuple[Tensor, Tensor]:
    """Return the row (n,) int64 of the nearest point of a tree to each place (n, 3), and its
    distance (n,); 0 and inf beyond the radius.
    """
    distance, row = tree.query(*exact_arrays(places), distance_upper_bound=radius)
    # SciPy returns the number of points if none is found
    pair = np.where(np.isfinite(distance), row, 0).astype(np.int64), distance
    rows, distances = (torch.from_numpy(each) for each in pair)
    return rows, distances.to(places.dtype)


@dataclass(frozen=True)
class Nearest:
    """Result of a nearest-point query.

    Attributes:
        index: (...) int64 row of the nearest scene point; 0 if none was found.
        distance: (...) metres in the scaled scene; inf if none was found.
        is_found: (...) bool, whether a scene point lies within the radius.
    """

    index: Tensor
    distance: Tensor
    is_found: Tensor


class NearestPointSearch:
    """Nearest-point search structure over fixed scene points.

    Args:
        points: (M, 3) metres, camera frame; M may be 0.
        normals: (M, 3) unit, or zero where unknown; stored for the caller.
        radius: search radius, metres.
    """

    def __init__(self, points: Tensor, normals: Tensor, radius: float = 0.15) -> None:
        self.points = points.detach()
        self.normals = normals.detach()
        self.radius = radius

    @cached_property
    def tree(self) -> cKDTree:
        """The k-d tree of the points, built when it is first used."""
        return search_tree(self.points)

    def query(self, vertices: Tensor, scale: float = 1.0, radius: float | None = None) -> Nearest:
        """Find the nearest scene point of each vertex; not differentiable.

        Args:
            vertices: (..., 3) metres, camera frame.
            scale: factor that the scene is scaled by about the camera.
            radius: metres in the scaled scene; None takes the structure's radius.
        """
        radius = self.radius if radius is None else radius
        flat = vertices.detach().reshape(-1, 3) / scale
        # cKDTree raises on non-finite queries.
        finite = torch.isfinite(flat).all(-1)
        flat = torch.where(finite[:, None], flat, 0.0)
        if len(self.points) == 0:
            index = torch.zeros(len(flat), dtype=torch.int64)
            distance = torch.full((len(flat),), torch.inf, dtype=flat.dtype)
        else:
            index, distance = self.lookup(flat, radius / scale)
        distance = distance * scale
        is_near = (distance < radius) & finite
        index = torch.where(is_near, index, 0)
        distance = torch.where(is_near, distance, torch.inf)
        shape = vertices.shape[:-1]
        return Nearest(index.reshape(shape), distance.reshape(shape), is_near.reshape(shape))

    def lookup(self, places: Tensor, radius: float) -> tuple[Tensor, Tensor]:
        """Return the index (n,) of the nearest of the unscaled points to each place (n, 3), and its
        distance (n,).

        A subclass may search in another way. Beyond the radius, the index may be any, and the
        distance any that is larger than the radius.
        """
        return nearest_indices(self.tree, places, radius)


def inside_body_boxes(points: Tensor, vertices: Tensor, margin: float) -> Tensor:
    """Return whether scene points (M, 3) lie in any body's bounding box, enlarged by a margin: (M,)
    bool.

    Args:
        points: (M, 3) metres.
        vertices: (B, V, 3) metres.
        margin: metres.
    """
    keep = torch.zeros(len(points), dtype=torch.bool)
    if not len(vertices):
        return keep
    low = vertices.amin(1) - margin
    high = vertices.amax(1) + margin
    # z first: it excludes most points, and one axis is cheaper than three. A body that is not
    # finite has no points.
    nearest = low[:, 2].nan_to_num(torch.inf).amin()
    farthest = high[:, 2].nan_to_num(-torch.inf).amax()
    z = points[:, 2].contiguous()
    rows = ((z > nearest) & (z < farthest)).nonzero(as_tuple=True)[0]
    columns = points.index_select(0, rows).T.contiguous()
    inside = torch.zeros_like(rows, dtype=torch.bool)
    for first, last in zip(low, high, strict=True):
        inside |= ((columns > first[:, None]) & (columns < last[:, None])).all(0)
    keep[rows[inside]] = True
    return keep
