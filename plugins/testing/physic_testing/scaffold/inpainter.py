"""Inpainting with one colour: the mean of the pixels near the mask."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core.errors import InputError
from physic_core.interfaces import Inpainter, Options

if TYPE_CHECKING:
    from physic_core.types import BoolArray, UInt8Array


class TemplateOptions(Options):
    """Settings of Template."""

    margin_px: int = Field(
        20, ge=1, description="width of the averaged border around the mask's box, px; 5-50 works"
    )


class Template(Inpainter):
    """Fills the mask with the mean colour of the surrounding pixels."""

    written_for = 1
    Options = TemplateOptions
    options: TemplateOptions

    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Image (H, W, 3) and mask (H, W), True = remove -> image of that size, unchanged where the
        mask is False.
        """
        if mask.shape != image.shape[:2] or mask.dtype != np.bool_:
            raise InputError(f"mask must be {image.shape[:2]} bool, got {mask.shape} {mask.dtype}")
        if mask.all():
            raise InputError(
                "mask covers the complete image: no pixel is left to take a color from"
            )
        filled = image.copy()  # a backend must not modify its input
        if mask.any():
            margin = self.options.margin_px
            rows = np.flatnonzero(mask.any(axis=1))
            columns = np.flatnonzero(mask.any(axis=0))
            near = np.zeros_like(mask)
            near[
                max(0, rows[0] - margin) : rows[-1] + margin + 1,
                max(0, columns[0] - margin) : columns[-1] + margin + 1,
            ] = True
            around = near & ~mask if (near & ~mask).any() else ~mask
            filled[mask] = image[around].mean(axis=0).round().astype(np.uint8)
        return filled
