"""The paper's lookup of nearest scene points on a grid of 128^3 nodes (sec. 4.1)."""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from physic_core.geometry import NearestPointSearch

_LEAST_MARGIN_M = 1e-3  # of the grid's box around coplanar points


class GridSearch(NearestPointSearch):
    """Nearest-point search by the nearest point of the closest node of a regular grid, which is
    approximate.

    The grid spans the bounding box of the points, enlarged by a tenth on each side, as in the
    released code. Nodes are searched exactly when first used. Vertices outside the grid are
    searched exactly.

    Args:
        points: (M, 3) metres, camera frame; M may be 0.
        normals: (M, 3) unit, or zero where unknown.
        radius: search radius, metres.
        cells: nodes along each axis.
    """

    def __init__(self, points: Tensor, normals: Tensor, radius: float, cells: int = 128) -> None:
        super().__init__(points, normals, radius)
        if not len(points):
            return
        low = points.amin(0)
        high = points.amax(0)
        margin = (0.1 * (high - low)).clamp(min=_LEAST_MARGIN_M)
        self._low = low - margin
        self._high = high + margin
        self._last = cells - 1
        self._table = torch.full((cells**3,), -1, dtype=torch.int64)
        self._exact = cKDTree(points.double().numpy(), balanced_tree=False, compact_nodes=False)

    def lookup(self, places: Tensor, radius: float) -> tuple[Tensor, Tensor]:
        """Return the point of the node of each place, and its distance."""
        flat = places.to(self._low)
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
        if not inside.all():
            index[~inside] = self._nearest(flat[~inside])
        return index, (places - self.points[index]).norm(dim=-1)

    def _nearest(self, places: Tensor) -> Tensor:
        _, index = self._exact.query(places.double().numpy())
        return torch.from_numpy(np.asarray(index, dtype=np.int64))
