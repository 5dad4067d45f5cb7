"""Outlier removal on a point map: depth edges and isolated points (paper Sec. 3.1 and 4.1)."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from physic_core.engine.scene.settings import Outliers
from physic_core.geometry.pointmap import knn_outliers, unsupported

__all__ = ["KNN_SHARE", "edge_ratio", "outlier_mask"]

EDGE_RATIO = 1.05
"""Farthest over nearest depth among 3 x 3 pixels, of a picture of 1024 px, beyond which a pixel is a depth edge."""

KNN_SHARE = 0.05
"""k of "knn" as a share of the short image side, the point itself among them; as released."""

_KNN_SIGMA = 1.45  # standard deviations over the mean beyond which a point is an outlier; as released
_REFERENCE_SIDE = 1024


def edge_ratio(outliers: Outliers, rows: int, columns: int) -> float:
    """Depth ratio of an edge in a picture of (rows, columns), with the slope of ``EDGE_RATIO`` at 1024 px.

    At most ``EDGE_RATIO`` squared, since real edges are as sharp in small pictures as in large ones. Infinite (no edge)
    if ``outliers`` is not "grid".
    """
    return EDGE_RATIO ** min(2.0, _REFERENCE_SIDE / max(rows, columns, 1)) if outliers == "grid" else math.inf


def outlier_mask(points: Tensor, valid: Tensor, outliers: Outliers, size: tuple[int, int] | None = None) -> Tensor:
    """(H, W) bool, valid points that are outliers.

    Args:
        points: (H, W, 3), any unit.
        valid: (H, W) bool.
        outliers: strategy, see :class:`SceneSettings`.
        size: (H, W) of the full picture, if ``points`` is a crop of it.
    """
    rows, columns = size or (valid.shape[0], valid.shape[1])
    if outliers == "off" or not bool(valid.any()):
        return torch.zeros_like(valid)
    if outliers == "grid":
        return unsupported(points[..., 2], valid, edge_ratio(outliers, rows, columns))
    drop = torch.zeros_like(valid)
    # The released code counts the point itself among its neighbours.
    neighbors = max(1, int(KNN_SHARE * min(rows, columns)) - 1)
    drop[valid] = knn_outliers(points[valid], neighbors, _KNN_SIGMA)
    return drop
