"""Filling what a mask covers, and nothing else."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.errors import BackendError

if TYPE_CHECKING:
    from collections.abc import Callable

    from physic_core.types import BoolArray, UInt8Array

__all__ = ["check_mask", "fill_within", "widened"]


def check_mask(image: UInt8Array, mask: BoolArray) -> BoolArray:
    """The mask as bool.

    Raises:
        BackendError: it has another size than the image (H, W, 3), or leaves nothing to go by.
    """
    import numpy as np

    mask = np.asarray(mask, bool)
    if mask.shape != image.shape[:2]:
        raise BackendError(
            f"the mask must have the image's size (H, W) = {image.shape[:2]}, got {mask.shape}: resize it first"
        )
    if mask.all():
        raise BackendError("the mask covers the whole image, which leaves nothing to fill it from: pass a smaller one")
    return mask


def fill_within(
    image: UInt8Array, mask: BoolArray, rim: float, fill: Callable[[UInt8Array, BoolArray], UInt8Array]
) -> UInt8Array:
    """Fill the mask, and leave the very same pixels outside of it.

    Args:
        image: (H, W, 3).
        mask: (H, W), True = fill.
        rim: share of the long side by which the hole that is shown is wider.
        fill: of the image and the wider hole; called only where there is a hole.

    Raises:
        BackendError: the mask has another size or leaves nothing to go by.
    """
    import numpy as np

    mask = check_mask(image, mask)
    return np.where(mask[..., None], fill(image, widened(mask, rim)), image) if mask.any() else image.copy()


def widened(mask: BoolArray, share: float) -> BoolArray:
    """A mask dilated by a disc of this share of its long side; the mask itself where that left nothing to go by."""
    radius = round(share * max(mask.shape))
    if not radius:
        return mask
    import cv2
    import numpy as np

    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    wider: BoolArray = cv2.dilate(mask.astype(np.uint8), disc) > 0
    return mask if wider.all() else wider
