"""Find flying pixels: pixels of a depth map between a near and a far surface."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray


_STEEP = 1.05  # ratio of the farthest to the nearest depth among 3 x 3 pixels; 1.03-1.1 works
_BENT = 0.02  # second difference of the inverse depth within 2 px, relative to it


def flying_pixels(inverse_depth: FloatArray) -> BoolArray:
    """Return a mask of flying pixels: pixels where depth changes steeply, but not along a plane.

    The inverse depth of a plane is linear at any angle of view, and as steep as an edge near the
    horizon of a floor. An edge is steep, and its inverse depth bends nearby.

    Args:
        inverse_depth: (H, W), positive, at the resolution of the network that made it.

    Returns:
        (H, W) bool.
    """
    import cv2

    values = np.ascontiguousarray(inverse_depth, dtype=np.float32)
    box = np.ones((3, 3), np.uint8)
    steep = cv2.dilate(values, box) > _STEEP * cv2.erode(values, box)
    # Kernels of a constant second derivative: [1, -2, 1] along each axis.
    second = np.zeros_like(values)
    for kernel in (np.array([[1.0, -2.0, 1.0]]), np.array([[1.0], [-2.0], [1.0]])):
        second = np.maximum(
            second, np.abs(cv2.filter2D(values, -1, kernel, borderType=cv2.BORDER_REPLICATE))
        )
    for row in (0, -1):
        second[row] = 0  # the replicated border bends every slope
        second[:, row] = 0
    bent = cv2.dilate(second / values, np.ones((5, 5), np.uint8)) > _BENT
    return np.asarray(steep & bent)
