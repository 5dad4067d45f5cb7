"""Outliers of points by the mean distance to their nearest neighbours (paper Sec. 4.1)."""

from __future__ import annotations

import torch
from scipy.spatial import cKDTree
from torch import Tensor

KNN_SHARE = 0.05
"""Number of neighbours, the point itself among them, as a share of the short image side; as
released.
"""

_SIGMA = 1.45  # outlier threshold over the mean, in standard deviations; as released


def knn_outliers(points: Tensor, neighbors: int) -> Tensor:
    """Return points with an unusually large mean squared distance to their neighbours, (M,) bool
    (paper Sec. 4.1).

    Args:
        points: (M, 3), any unit, finite.
        neighbors: k, the point itself not counted.
    """
    if min(neighbors, len(points) - 1) < 1:
        return torch.zeros(len(points), dtype=torch.bool)
    distance, _ = nearest_other_points(points, neighbors)
    spread = distance.square().mean(1)
    return spread > spread.mean() + _SIGMA * spread.std(correction=0)


def image_outliers(points: Tensor, rows: int, columns: int) -> Tensor:
    """Return which of points (M, 3) of an image of this size are outliers: (M,) bool."""
    # The released code counts the point itself among its neighbours.
    return knn_outliers(points, max(1, int(KNN_SHARE * min(rows, columns)) - 1))


def nearest_other_points(points: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """Return the k nearest neighbours of each point in a point cloud, without the point itself.

    Args:
        points: (M, 3), any unit, finite; M >= 2.
        count: k >= 1; at most M - 1 are returned.

    Returns:
        distance: (M, k) float64, ascending.
        index: (M, k) int64 rows of ``points``.
    """
    cloud = points.detach().double().numpy()
    tree = cKDTree(cloud, balanced_tree=False, compact_nodes=False)
    # The first neighbour is the point itself.
    distance, index = tree.query(cloud, k=min(count, len(cloud) - 1) + 1, workers=-1)
    return torch.from_numpy(distance[:, 1:]), torch.from_numpy(index[:, 1:])
