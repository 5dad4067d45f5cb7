"""Join the looks of a depth network at a photo, and at the photo without its people.

People bend the ground that they stand on, and hide what is behind them: the trend is that of the
inpainted photo. Steps and details beside the people are those of the photo, seen larger.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_networks.pictures import resize_map

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray

# Shares of the long side.
_TREND = 0.03  # standard deviation of the window of the trend
_RAMP = 0.015  # beside the people, from which on all details are the photo's

_LEAST_SHARE = 1e-3  # of pixels beside people in the window, below which the trend fades
_REWEIGHTED = 10  # fits of the line with new weights


def scene_disparity(inpainted: FloatArray, photo: FloatArray, is_visible: BoolArray) -> FloatArray:
    """Return the disparity (H, W) of a scene, in the unit of the inpainted photo.

    Args:
        inpainted: (h, w) disparity of the inpainted photo.
        photo: (H, W) disparity of the photo with its people, in a unit of its own.
        is_visible: (H, W) bool, pixels beside the people.
    """
    import cv2

    scene = resize_map(inpainted, *photo.shape)
    line = line_through(photo[is_visible], scene[is_visible])
    if line is None:
        return scene
    long = max(photo.shape)
    other = np.where(is_visible, line[0] * photo + line[1] - scene, 0).astype(np.float32)
    beside = is_visible.astype(np.float32)
    trend, share = (cv2.GaussianBlur(each, (0, 0), _TREND * long) for each in (other, beside))
    away = cv2.distanceTransform(is_visible.astype(np.uint8), cv2.DIST_L2, 5)
    detail = other - trend / np.maximum(share, _LEAST_SHARE)
    return np.asarray(np.maximum(scene + np.minimum(away / (_RAMP * long), 1) * detail, 0))


def line_through(x: FloatArray, y: FloatArray) -> tuple[float, float] | None:
    """Return slope, > 0, and shift of the line of y over x, both (n,), by reweighted least squares;
    None if there is none.
    """
    x, y = (np.asarray(each, np.float64) for each in (x, y))
    weight = np.ones_like(x)
    slope = 0.0
    shift = 0.0
    for _ in range(_REWEIGHTED if len(x) else 0):
        mean_x = np.average(x, weights=weight)
        mean_y = np.average(y, weights=weight)
        spread = np.average((x - mean_x) ** 2, weights=weight)
        if spread <= 0:
            return None
        slope = np.average((x - mean_x) * (y - mean_y), weights=weight) / spread
        shift = mean_y - slope * mean_x
        rest = np.abs(y - slope * x - shift)
        weight = 1 / (1 + (rest / (1.5 * np.median(rest) + 1e-9)) ** 2)
    return (float(slope), float(shift)) if slope > 0 else None
