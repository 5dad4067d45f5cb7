"""Errors of depth maps; each function maps a depth map (H, W) in metres to another.

Non-finite depths (sky, unknown) are unchanged and do not affect other pixels.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray

_EDGE_RATIO = 1.06  # farthest over nearest depth among 3 x 3 pixels
_REACH = 2.0  # a blur_depth_edges edge fades out over this many of its widths


def flatten_relief(
    depth: FloatArray, mask: BoolArray, relief_lost: float, offset: float
) -> FloatArray:
    """Reduce a person's relief about the median depth, and shift the person by a factor
    exp(offset).
    """
    seen = mask & np.isfinite(depth)
    if not seen.any() or relief_lost == offset == 0:
        return depth
    middle = float(np.median(depth[seen]))
    result = depth.copy()
    result[seen] = (middle + (1 - relief_lost) * (depth[seen] - middle)) * np.exp(offset)
    return result


def blur_depth_edges(depth: FloatArray, width_px: float) -> FloatArray:
    """Blur depth edges over ``width_px``, so that silhouette pixels lie between foreground and
    background.
    """
    import cv2

    if width_px == 0:
        return depth
    known = np.isfinite(depth)
    log_depth = np.where(known, np.log(np.where(known, depth, 1.0)), 0.0)
    kernel = np.ones((3, 3), np.uint8)
    low = np.where(known, log_depth, 99.0)
    high = np.where(known, log_depth, -99.0)
    edge = cv2.dilate(high, kernel) - cv2.erode(low, kernel) > np.log(_EDGE_RATIO)
    if not edge.any():
        return depth
    weight = cv2.GaussianBlur(known.astype(np.float64), (0, 0), width_px)
    blurred = cv2.GaussianBlur(log_depth, (0, 0), width_px) / np.maximum(weight, 1e-9)
    away = cv2.distanceTransform((~edge).astype(np.uint8), cv2.DIST_L2, 5).astype(np.float64)
    near = np.clip(1 - away / (_REACH * width_px), 0, 1)
    return np.where(known, np.exp((1 - near) * log_depth + near * blurred), depth)
