"""Convert the disparity of relative depth networks to points.

Disparity is inverse depth up to scale and shift. Networks are trained with 0 for infinity, and return it for the sky.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.adapters.pictures import resize_map

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Intrinsics

_LEAST_GAP = 0.002  # ranges of the disparity between infinity and the farthest point, so that depth stays finite
_SKY = 0.004  # ranges of the disparity


def clip_disparity(disparity: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Clip disparity (h, w) to a small positive minimum, and return a mask (h, w) of sky and NaN pixels."""
    low, high = np.percentile(disparity, [1, 99])
    span = max(float(high - low), 1e-6)
    lost: BoolArray = np.asarray(~(disparity >= _SKY * span))
    gap: FloatArray = np.maximum(np.where(lost, 0.0, disparity), _LEAST_GAP * span)
    return gap, lost


def points_from_disparity(gap: FloatArray, lost: BoolArray, camera: Intrinsics) -> tuple[FloatArray, BoolArray]:
    """Compute points on the rays of a camera with z = 1 / disparity, in units of the median distance.

    Args:
        gap: (h, w) positive inverse depth, at any resolution.
        lost: (h, w) bool, pixels without a value; not all.
        camera: of the photo.

    Returns:
        (H, W, 3) float32 points, and (H, W) bool, which are valid.
    """
    # Resample the inverse depth: it may be averaged between a near and a far surface.
    z = 1 / resize_map(gap / np.median(gap[~lost]), camera.height, camera.width)
    valid = resize_map(lost, camera.height, camera.width) < 0.5
    u = ((np.arange(camera.width) - camera.cx) / camera.fx).astype(np.float32)
    v = ((np.arange(camera.height) - camera.cy) / camera.fy).astype(np.float32)
    return np.stack([z * u[None], z * v[:, None], z], axis=-1).astype(np.float32), valid
