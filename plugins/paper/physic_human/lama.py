"""Remove people from a photo with LaMa (Suvorov et al. 2022), from its TorchScript file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import Inpainter, Options
from physic_networks.networks import WEIGHTS_HELP, TorchBackend, open_torchscript, to_numpy
from physic_networks.pictures import inpaint_masked, normalized_nchw, resize_image

if TYPE_CHECKING:
    from physic_core.types import BoolArray, UInt8Array

MULTIPLE = 8
"""Height and width of LaMa's input are multiples of this, px."""
_RIM = 0.004  # of the long side, by which the hole of the network is wider than the filled one
_LONGEST_PX = 1536  # long side of the photo that the network sees


class LamaOptions(Options):
    """Settings of Lama."""

    weights: str = Field("big-lama", description=WEIGHTS_HELP)


class Lama(TorchBackend, Inpainter):
    """LaMa inpainter. It fills only the mask: shadows and mirror images of removed people stay."""

    written_for = 1
    Options = LamaOptions
    options: LamaOptions

    def build(self, device: str) -> Any:
        """Open the TorchScript file."""
        return open_torchscript(self.file(), device)

    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Fill the mask (H, W), True = remove, in an image (H, W, 3); pixels outside the mask stay
        identical.

        Raises:
            InputError: the image is not a valid photo.
            BackendError: the mask has another size or covers the whole image, or load() was not
                called.
        """
        return inpaint_masked(image, mask, _RIM, self._fill)

    def run(self, inputs: Any) -> Any:
        """Run the network on RGB (1, 3, H, W) from 0 to 1, and a mask (1, 1, H, W), 1 in the
        hole.
        """
        import torch

        image, mask = (torch.from_numpy(array).to(self.device) for array in inputs)
        try:
            with torch.inference_mode():
                return self.network(image, mask)
        except RuntimeError as cause:
            raise BackendError(f"LaMa does not take {tuple(image.shape)}: {cause}") from cause

    def _fill(self, image: UInt8Array, hole: BoolArray) -> UInt8Array:
        """Fill a hole: resize, pad by reflection, run the network, and resize back."""
        height, width = hole.shape
        scale = min(1.0, _LONGEST_PX / max(height, width))
        inner = (max(1, round(height * scale)), max(1, round(width * scale)))
        margins = [(0, -side % MULTIPLE) for side in inner]
        small = resize_image(image, *inner, "area")
        # A pixel that is partly hole counts as hole, since its colour is partly that of the removed
        # person.
        covered = resize_image(hole.astype(np.float32), *inner, "area") > 0
        frame = normalized_nchw(np.pad(small, [*margins, (0, 0)], mode="symmetric"))
        covered = np.pad(covered, margins, mode="symmetric").astype(np.float32)
        answer = to_numpy(self.run((frame, covered[None, None])))[0].transpose(1, 2, 0)
        shown = 255 * answer[: inner[0], : inner[1]]
        back = resize_image(np.ascontiguousarray(shown), height, width, "bicubic")
        return np.asarray(back.round().clip(0, 255), np.uint8)
