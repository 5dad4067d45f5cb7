"""Inpainting with OpenCV by Telea's fast marching.

A hole much wider than the brush becomes streaks, and takes long. Such a hole is filled on a reduced
image, and the smooth fill is enlarged inside the mask.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.errors import InputError

if TYPE_CHECKING:
    from physic_core.types import BoolArray, UInt8Array


class TeleaOptions(interfaces.Options):
    """Settings of Telea."""

    radius_px: float = Field(
        5.0,
        gt=0,
        le=50,
        description="Radius around a pixel from which it is filled, px; 3-8 works.",
    )
    max_hole_px: int = Field(
        160,
        ge=16,
        le=100_000,
        description="Longest side of a hole that is filled at full resolution, px. A larger one "
        "is filled on an image "
        "reduced until it fits; smaller is faster and smoother.",
    )


class Telea(interfaces.Inpainter):
    """Inpainter by fast marching (Telea 2004): fills the hole from its border inwards with a
    weighted mean of known pixels.

    The weights continue lines of equal brightness into the hole.
    """

    written_for = 1
    Options = TeleaOptions
    options: TeleaOptions

    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Fill the mask (H, W), True = remove, in an image (H, W, 3); unmasked pixels keep their
        values.

        Raises:
            InputError: image or mask has another shape or dtype, or the mask covers everything.
        """
        _check_mask(image, mask)
        return _fill(image, mask, self.options)


def _check_mask(image: UInt8Array, mask: BoolArray) -> None:
    if mask.shape != image.shape[:2] or mask.dtype != np.bool_:
        raise InputError(
            f"The mask must be {image.shape[:2]} bool like the image, got {mask.shape} "
            f"{mask.dtype}: resize it, or threshold it."
        )
    if mask.all():
        raise InputError(
            "The mask covers the whole image: leave some pixels unmasked to fill the hole from."
        )


def _fill(image: UInt8Array, mask: BoolArray, options: TeleaOptions) -> UInt8Array:
    """Fill a hole, on a reduced image if it is large."""
    import cv2

    filled = image.copy()
    if not mask.any():
        return filled
    rows = np.flatnonzero(mask.any(1))
    columns = np.flatnonzero(mask.any(0))
    longest = int(max(rows[-1] - rows[0], columns[-1] - columns[0])) + 1
    factor = -(-longest // options.max_hole_px)
    if factor == 1:
        answer = cv2.inpaint(image, mask.astype(np.uint8), options.radius_px, cv2.INPAINT_TELEA)
    else:
        small, hole = downsample_known(image, mask, factor)
        small = cv2.inpaint(small, hole.astype(np.uint8), options.radius_px, cv2.INPAINT_TELEA)
        answer = _enlarge(small, image.shape[:2], factor)
    filled[mask] = answer[mask]
    return filled


def downsample_known(
    image: UInt8Array, mask: BoolArray, factor: int
) -> tuple[UInt8Array, BoolArray]:
    """Downsample an image by an integer factor with means over unmasked pixels only.

    Args:
        image: (H, W, 3) uint8.
        mask: (H, W) bool.
        factor: pixels of ``image`` along each side of a small pixel; the last row and column may
            hold fewer.

    Returns:
        (ceil(H / factor), ceil(W / factor), 3) uint8, and the small mask: True where no unmasked
        pixel fell.
    """
    height, width = mask.shape
    rows = np.arange(0, height, factor)
    columns = np.arange(0, width, factor)
    is_known = ~mask
    weighted = np.where(is_known[..., None], image, 0).astype(np.int64)
    total = np.add.reduceat(np.add.reduceat(weighted, rows, axis=0), columns, axis=1)
    count = np.add.reduceat(
        np.add.reduceat(is_known.astype(np.int64), rows, axis=0), columns, axis=1
    )
    small = (total + count[..., None] // 2) // np.maximum(count, 1)[..., None]
    return small.astype(np.uint8), count == 0


def _enlarge(small: UInt8Array, shape: tuple[int, int], factor: int) -> UInt8Array:
    # Pixel centres are integers: small pixel i is the mean of factor * i ... factor * i + factor -
    # 1.
    """Enlarge an image by an integer factor, bilinear."""
    import cv2

    height, width = shape
    u = (np.arange(width, dtype=np.float32) - (factor - 1) / 2) / factor
    v = (np.arange(height, dtype=np.float32) - (factor - 1) / 2) / factor
    grid_u, grid_v = np.meshgrid(u, v)
    large: UInt8Array = cv2.remap(
        small, grid_u, grid_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return large
