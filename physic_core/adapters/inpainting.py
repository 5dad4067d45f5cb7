"""Inpaint the pixels of a mask and leave all others unchanged."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import BackendError

if TYPE_CHECKING:
    from collections.abc import Callable

    from physic_core.types import BoolArray, UInt8Array


def check_mask(image: UInt8Array, mask: BoolArray) -> BoolArray:
    """Return the mask (H, W) of an image (H, W, 3) as bool, after checking its size.

    Raises:
        BackendError: its size differs from the image's, or it covers the complete image.
    """
    mask = np.asarray(mask, bool)
    if mask.shape != image.shape[:2]:
        raise BackendError(
            f"the mask must have the image's size (H, W) = {image.shape[:2]}, got {mask.shape}: resize it first"
        )
    if mask.all():
        raise BackendError("the mask covers the whole image, which leaves nothing to fill it from: pass a smaller one")
    return mask


def inpaint_masked(
    image: UInt8Array, mask: BoolArray, rim: float, fill: Callable[[UInt8Array, BoolArray], UInt8Array]
) -> UInt8Array:
    """Inpaint the pixels of a mask; pixels outside it are not changed.

    Args:
        image: (H, W, 3).
        mask: (H, W), True = fill.
        rim: the mask passed to ``fill`` is dilated by this share of the long side.
        fill: inpainting function of the image and the dilated mask; not called for an empty mask.

    Raises:
        BackendError: the mask's size differs from the image's, or it covers the complete image.
    """
    mask = check_mask(image, mask)
    return np.where(mask[..., None], fill(image, dilate_mask(mask, rim)), image) if mask.any() else image.copy()


def dilate_mask(mask: BoolArray, share: float) -> BoolArray:
    """Dilate a mask by a disc, whose radius is ``share`` times the long side of the mask array.

    The mask is unchanged if the result would cover the complete image.
    """
    wider = dilate(mask, share * max(mask.shape))
    return mask if wider.all() else wider


def dilate(mask: BoolArray, radius_px: float) -> BoolArray:
    """Dilate a mask (H, W) by a disc of radius ``radius_px``, rounded."""
    import cv2

    radius = round(radius_px)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    wider: BoolArray = cv2.dilate(mask.astype(np.uint8), disc) > 0
    return wider
