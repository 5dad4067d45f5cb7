"""What every backend of this plugin asks of its input."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError

if TYPE_CHECKING:
    from physic_core.types import BoolArray, UInt8Array

__all__ = ["check_image", "check_mask"]


def check_image(image: UInt8Array) -> None:
    """Refuse what is not an (H, W, 3) uint8 image.

    Raises:
        InputError: another shape or dtype came.
    """
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        raise InputError(
            f"The image must be (H, W, 3) uint8 RGB, got {image.shape} {image.dtype}: convert it before the call."
        )


def check_mask(image: UInt8Array, mask: BoolArray) -> None:
    """Refuse a mask that is not (H, W) bool of the image's size, or that leaves nothing to fill from.

    Raises:
        InputError: another shape or dtype came, or every pixel is masked.
    """
    if mask.shape != image.shape[:2] or mask.dtype != np.bool_:
        raise InputError(
            f"The mask must be {image.shape[:2]} bool like the image, got {mask.shape} {mask.dtype}: "
            "resize it, or threshold it."
        )
    if mask.all():
        raise InputError("The mask covers the whole image: leave some pixels unmasked to fill the hole from.")
