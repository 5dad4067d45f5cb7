"""What every backend of this plugin asks of a photo."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError

if TYPE_CHECKING:
    from physic_core.types import UInt8Array

__all__ = ["check_photo"]


def check_photo(image: UInt8Array) -> None:
    """Refuse what is not an (H, W, 3) uint8 image.

    Raises:
        InputError: another shape or dtype came.
    """
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        raise InputError(f"a photo must be (H, W, 3) uint8 RGB, got {image.shape} {image.dtype}: convert it first")
