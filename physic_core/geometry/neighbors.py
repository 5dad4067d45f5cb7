"""Nearest scene point of each body vertex within a search radius.

Strategies: ``kdtree`` (exact, the default), ``brute`` (exact, a reference for tests) and ``grid`` (the paper's 128^3
lookup, sec. 4.1, approximate). To query a scene scaled by ``s``, the vertices are divided by ``s``, so that the search
structure stays valid.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
import torch
from scipy.spatial import cKDTree

from physic_core.errors import PhysicError

if TYPE_CHECKING:
    from torch import Tensor

__all__ = ["Nearest", "NearestPointSearch", "Strategy", "inside_body_boxes", "nearest_other_points"]

Strategy = Literal["kdtree", "grid", "brute"]

_LEAF = 32  # points of a leaf of the tree
_LEAST_MARGIN_M = 1e-3  # of the grid's box around coplanar points
_BRUTE_PAIRS = 4_000_000  # distances per chunk: 32 MB in float64


@dataclass(frozen=True)
class Nearest:
    """Result of a nearest-point query.

    Attributes:
        index: (...) int64 row of the nearest scene point; 0 if none was found.
        distance: (...) metres in the scaled scene; inf if none was found.
        found: (...) bool, whether a scene point lies within the radius.
    """

    index: Tensor
    distance: Tensor
    found: Tensor


class NearestPointSearch:
    """Nearest-point search structure over fixed scene points.

    Args:
        points: (M, 3) metres, camera frame; M may be 0.
        normals: (M, 3) unit, or zero where unknown; stored for the caller.
        radius: search radius, metres.
        strategy: "kdtree", "grid" or "brute".
        cells: nodes of the grid along each axis.

    Raises:
        PhysicError: the strategy is unknown, or the shapes do not match.
    """

    def __init__(
        self, points: Tensor, normals: Tensor, radius: float = 0.15, strategy: Strategy = "kdtree", cells: int = 128
    ) -> None:
        if points.ndim != 2 or points.shape[-1] != 3 or normals.shape != points.shape:
            raise PhysicError(
                f"scene points and normals must both be (M, 3), got {tuple(points.shape)} and {tuple(normals.shape)}: "
                "flatten the point map first"
            )
        if strategy not in ("kdtree", "grid", "brute"):
            raise PhysicError(f"unknown nearest-point strategy {strategy!r}: use 'kdtree', 'grid' or 'brute'")
        self.points = points.detach()
        self.normals = normals.detach()
        self.radius = radius
        self.strategy = strategy
        self._tree: cKDTree | None = None
        self._grid: _Grid | None = None
        if strategy == "kdtree" and len(points):
            # For pixel samples and a bounded distance, this tree is built faster and searched three times as fast.
            exact = self.points.cpu().double().numpy()
            self._tree = cKDTree(exact, leafsize=_LEAF, balanced_tree=False, compact_nodes=False)
        elif strategy == "grid" and len(points):
            self._grid = _Grid(self.points, cells)

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
        flat = torch.where(finite[:, None], flat, torch.zeros_like(flat))
        if len(self.points) == 0:
            index = torch.zeros(len(flat), dtype=torch.int64, device=flat.device)
            distance = torch.full((len(flat),), torch.inf, dtype=flat.dtype, device=flat.device)
        elif self._tree is not None:
            index, distance = _query_tree(self._tree, flat, radius / scale)
        elif self._grid is not None:
            index = self._grid.lookup(flat)
            distance = (flat - self.points[index]).norm(dim=-1)
        else:
            index, distance = _query_brute(self.points, flat)
        distance = distance * scale
        found = (distance < radius) & finite
        index = torch.where(found, index, torch.zeros_like(index))
        distance = torch.where(found, distance, torch.full_like(distance, torch.inf))
        shape = vertices.shape[:-1]
        return Nearest(index.reshape(shape), distance.reshape(shape), found.reshape(shape))


def inside_body_boxes(points: Tensor, vertices: Tensor, margin: float) -> Tensor:
    """Return whether scene points (M, 3) lie in any body's bounding box, enlarged by a margin: (M,) bool.

    Args:
        points: (M, 3) metres.
        vertices: (B, V, 3) metres.
        margin: metres.
    """
    keep = torch.zeros(len(points), dtype=torch.bool, device=points.device)
    for body in vertices:
        low, high = body.amin(0) - margin, body.amax(0) + margin
        # z first: it excludes most points, and one axis is cheaper than three.
        rows = ((points[:, 2] > low[2]) & (points[:, 2] < high[2])).nonzero(as_tuple=True)[0]
        inside = ((points[rows, :2] > low[:2]) & (points[rows, :2] < high[:2])).all(-1)
        keep[rows[inside]] = True
    return keep


def _query_tree(tree: cKDTree, flat: Tensor, radius: float) -> tuple[Tensor, Tensor]:
    distance, index = tree.query(flat.cpu().double().numpy(), distance_upper_bound=radius)
    index = np.where(np.isfinite(distance), index, 0)  # SciPy returns the number of points if none is found
    return (
        torch.from_numpy(index.astype(np.int64)).to(flat.device),
        torch.from_numpy(distance).to(flat.device, flat.dtype),
    )


def _query_brute(points: Tensor, flat: Tensor) -> tuple[Tensor, Tensor]:
    index, distance = [], []
    exact = points.double()
    for chunk in torch.split(flat.double(), max(1, _BRUTE_PAIRS // len(points))):
        # The default mode uses a matrix product and loses millimetres far from the origin.
        pairs = torch.cdist(chunk, exact, compute_mode="donot_use_mm_for_euclid_dist")
        nearest = pairs.min(dim=1)
        index.append(nearest.indices)
        distance.append(nearest.values)
    if not index:
        return flat.new_zeros(0, dtype=torch.int64), flat.new_zeros(0)
    return torch.cat(index), torch.cat(distance).to(flat.dtype)


class _Grid:
    """The paper's lookup: the nearest point of the closest node of a regular grid.

    The grid spans the bounding box of the points, enlarged by a tenth on each side, as in the released code. Nodes are
    searched exactly when first used. Vertices outside the grid are searched exactly.
    """

    def __init__(self, points: Tensor, cells: int) -> None:
        low, high = points.amin(0), points.amax(0)
        margin = (0.1 * (high - low)).clamp(min=_LEAST_MARGIN_M)
        self._low, self._high = low - margin, high + margin
        self._last = cells - 1
        self._table = torch.full((cells**3,), -1, dtype=torch.int64, device=points.device)
        self._tree = cKDTree(points.cpu().double().numpy(), balanced_tree=False, compact_nodes=False)

    def lookup(self, flat: Tensor) -> Tensor:
        flat = flat.to(self._low)
        extent = self._high - self._low
        inside = ((flat >= self._low) & (flat <= self._high)).all(-1)
        node = ((flat - self._low) / extent * self._last).round().long().clamp(0, self._last)
        row = (node[:, 0] * (self._last + 1) + node[:, 1]) * (self._last + 1) + node[:, 2]
        new = torch.unique(row[inside & (self._table[row] < 0)])
        if len(new):
            count = self._last + 1
            at = torch.stack([new // count**2, new // count % count, new % count], -1).double()
            self._table[new] = self._nearest(self._low.double() + at / self._last * extent.double())
        index = self._table[row]
        if not bool(inside.all()):
            index[~inside] = self._nearest(flat[~inside])
        return index

    def _nearest(self, places: Tensor) -> Tensor:
        _, index = self._tree.query(places.cpu().double().numpy())
        return torch.from_numpy(np.asarray(index, dtype=np.int64)).to(places.device)


def nearest_other_points(points: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """Return the k nearest neighbours of each point in a point cloud, without the point itself.

    Args:
        points: (M, 3), any unit, finite; M >= 2.
        count: k >= 1; at most M - 1 are returned.

    Returns:
        distance: (M, k) float64, ascending.
        index: (M, k) int64 rows of ``points``.
    """
    cloud = points.detach().cpu().double().numpy()
    tree = cKDTree(cloud, balanced_tree=False, compact_nodes=False)
    # The first neighbour is the point itself.
    distance, index = tree.query(cloud, k=min(count, len(cloud) - 1) + 1, workers=-1)
    return torch.from_numpy(distance[:, 1:]).to(points.device), torch.from_numpy(index[:, 1:]).to(points.device)
