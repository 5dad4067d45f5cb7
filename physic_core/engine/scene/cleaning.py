"""Outlier removal on a point map: depth edges and isolated points (paper Sec. 3.1 and 4.1)."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from physic_core.engine.scene.settings import OutlierMethod
from physic_core.geometry.pointmap import isolated_pixels, knn_outliers

__all__ = ["KNN_SHARE", "edge_ratio", "outlier_mask"]

EDGE_RATIO = 1.05
"""Largest depth ratio within 3 x 3 pixels that is no depth edge, for an image of 1024 px."""

KNN_SHARE = 0.05
"""k of "knn", including the point itself, as a share of the short image side; as released."""

_KNN_SIGMA = 1.45  # outlier threshold over the mean, in standard deviations; as released
_REFERENCE_SIDE = 1024


def edge_ratio(outliers: OutlierMethod, rows: int, columns: int) -> float:
    """Return the threshold of the depth ratio at an edge: ``EDGE_RATIO`` for an image side of 1024 px, else scaled.

    The threshold is at most ``EDGE_RATIO`` squared, since edges are sharp in small images too. The threshold is
    infinite (no edge) if ``outliers`` is not "grid".
    """
    return EDGE_RATIO ** min(2.0, _REFERENCE_SIDE / max(rows, columns, 1)) if outliers == "grid" else math.inf


def outlier_mask(points: Tensor, valid: Tensor, outliers: OutlierMethod, size: tuple[int, int] | None = None) -> Tensor:
    """Return valid points that are outliers: (H, W) bool.

    Args:
        points: (H, W, 3), any unit.
        valid: (H, W) bool.
        outliers: method, see :class:`SceneSettings`.
        size: (H, W) of the full image, if ``points`` is a crop of it.
    """
    rows, columns = size or (valid.shape[0], valid.shape[1])
    if outliers == "off" or not bool(valid.any()):
        return torch.zeros_like(valid)
    if outliers == "grid":
        return isolated_pixels(points[..., 2], valid, edge_ratio(outliers, rows, columns))
    drop = torch.zeros_like(valid)
    # The released code counts the point itself among its neighbours.
    neighbors = max(1, int(KNN_SHARE * min(rows, columns)) - 1)
    drop[valid] = knn_outliers(points[valid], neighbors, _KNN_SIGMA)
    return drop
