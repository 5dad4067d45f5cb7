"""Check the masks of inpainters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError

if TYPE_CHECKING:
    from physic_core.types import BoolArray, UInt8Array

__all__ = ["check_mask"]


def check_mask(image: UInt8Array, mask: BoolArray) -> None:
    """Raise InputError if a mask is not (H, W) bool of the image's size, or covers the whole image.

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
