"""Masks of a photo."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import BoolArray


def dilate(mask: BoolArray, radius_px: float) -> BoolArray:
    """Dilate a mask (H, W) by a disc of radius ``radius_px``, rounded."""
    import cv2

    radius = round(radius_px)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    wider: BoolArray = cv2.dilate(mask.astype(np.uint8), disc) > 0
    return wider
