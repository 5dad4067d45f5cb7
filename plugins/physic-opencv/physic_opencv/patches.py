"""Inpaint with texture copied from elsewhere in the photo."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_opencv import patchmatch
from physic_opencv.checks import check_mask

if TYPE_CHECKING:
    from physic_core.types import BoolArray, UInt8Array

__all__ = ["PatchBased", "PatchOptions"]


class PatchOptions(interfaces.Options):
    """Settings of :class:`PatchBased`."""

    patch_radius_px: int = Field(
        3, ge=1, le=7, description="Patches are 2 r + 1 px wide on the working image; 2-4 works."
    )
    working_px: int = Field(
        9000,
        ge=500,
        le=10_000_000,
        description="Pixels of the hole on the working image; the photo is reduced until the hole is this small. More "
        "is sharper and slower in proportion.",
    )
    rounds: int = Field(
        5, ge=1, le=50, description="Rounds of search and vote on each level of the pyramid; 3-8 works."
    )
    seed: int = Field(0, ge=0, le=2**32 - 1, description="Seed of the random search.")


class PatchBased(interfaces.Inpainter):
    """Inpainter by coarse-to-fine patch search and voting (Wexler et al. 2007; PatchMatch, Barnes et al. 2009).

    Slower than diffusion, a few seconds for a person in a 720p photo, but floors keep their texture.
    """

    Options = PatchOptions
    options: PatchOptions

    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Fill the mask (H, W), True = remove, in an image (H, W, 3); unmasked pixels keep their values.

        Raises:
            InputError: image or mask has another shape or dtype, or too little is unmasked to take a patch from.
        """
        check_mask(image, mask)
        filled = image.copy()
        if mask.any():
            answer = patchmatch.fill_by_patches(
                image,
                mask,
                radius=self.options.patch_radius_px,
                working_px=self.options.working_px,
                rounds=self.options.rounds,
                rng=np.random.default_rng(self.options.seed),
            )
            filled[mask] = answer[mask]
        return filled
