"""Inpaint by pull-push (Gortler et al., The Lumigraph, 1996): average known pixels down an image
pyramid until none is unknown, then fill the unknown pixels from the coarser levels.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from pydantic import Field

from physic_core.errors import InputError
from physic_core.interfaces import Inpainter, Options

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.floating[Any]]


class PullPushOptions(Options):
    """Settings of PullPush."""

    certainty: float = Field(
        1.0,
        gt=0,
        le=4,
        description="factor of the known share of coarse pixels: 4 keeps detail at the rim, 0.5 is "
        "smoother",
    )


class PullPush(Inpainter):
    """Inpainter by pull-push: image pyramids of the image and of the known share of each pixel."""

    written_for = 1
    Options = PullPushOptions
    options: PullPushOptions

    def infer(self, image: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
        """Fill the mask (H, W), True = remove, in an image (H, W, 3); unmasked pixels keep their
        values.
        """
        if mask.shape != image.shape[:2] or mask.dtype != np.bool_:
            raise InputError(f"mask must be {image.shape[:2]} bool, got {mask.shape} {mask.dtype}")
        if mask.all():
            raise InputError("mask covers the whole image: nothing is left to fill it from")
        weight = (~mask).astype(np.float32)[..., None]
        filled = self._fill(image.astype(np.float32) * weight, weight)
        return np.where(mask[..., None], filled.round().clip(0, 255).astype(np.uint8), image)

    def _fill(self, weighted: Floats, weight: Floats) -> Floats:
        """Return the colours (H, W, 3), given known shares (H, W, 1) and colours times known
        shares.
        """
        colours: Floats = weighted / np.maximum(weight, 1e-6)
        if weight.min() >= 1 or max(weight.shape) == 1:
            return colours
        height, width = weight.shape[:2]
        down = cv2.pyrDown(weighted)
        share = cv2.pyrDown(weight)[..., None]
        gain = np.minimum(1, self.options.certainty * share) / np.maximum(share, 1e-6)
        coarse = cv2.pyrUp(self._fill(down * gain, share * gain), dstsize=(width, height))
        colours = weight * colours + (1 - weight) * coarse
        return colours
