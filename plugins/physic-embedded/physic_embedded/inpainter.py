"""Taking people out of a photo with MI-GAN."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import Inpainter, Options
from physic_embedded.networks.sessions import Networks

if TYPE_CHECKING:
    from physic_core.types import BoolArray, UInt8Array

__all__ = ["MiGan", "MiGanOptions"]


class MiGanOptions(Options):
    """Settings of :class:`MiGan`."""

    rim: float = Field(
        default=0.004,
        ge=0,
        le=0.1,
        description="Share of the long side by which the hole that the network sees is wider than the one it fills: "
        "at the edge its fill takes on the colours of what is removed. 0 gives the network's own soft edge.",
    )
    threads: int = Field(default=2, ge=0, description="Threads inside one operator; 0 lets onnxruntime choose.")


class MiGan(Inpainter):
    """MI-GAN for 512 px, trained on Places2, run on the part of the photo about the hole, at any size.

    The fill is sharp for holes up to about 512 px across and gets blurred above that. Where little but hole is left, it
    is imagination. A hole that is much larger than the person invites invented figures, so dilate little: 0.4 to 1.2 %
    of the photo's long side.
    """

    Options: ClassVar[type[Options]] = MiGanOptions
    options: MiGanOptions

    def __init__(self, options: MiGanOptions | None = None) -> None:
        super().__init__(options)
        self._networks = Networks("migan_512_places2")

    def load(self, device: str = "cpu") -> None:
        """Open the network.

        Raises:
            DeviceError: the device is not there.
        """
        self._networks.open(device, self.options.threads)

    def close(self) -> None:
        """Let go of the network."""
        self._networks.close()

    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Image (H, W, 3) and mask (H, W), True = remove -> image, the very same pixels where the mask is False.

        Raises:
            BackendError: the mask has another size, or leaves nothing to go by.
        """
        session = self._networks["migan_512_places2"]
        mask = np.asarray(mask, bool)
        if mask.shape != image.shape[:2]:
            raise BackendError(
                f"the mask must have the image's size (H, W) = {image.shape[:2]}, got {mask.shape}: resize it first"
            )
        if not mask.any():
            return image.copy()
        if mask.all():
            raise BackendError(
                "the mask covers the whole image, which leaves nothing to fill it from: pass a smaller one"
            )
        hole = self._with_rim(mask)
        keep = np.where(hole, 0, 255).astype(np.uint8)
        planes = np.ascontiguousarray(image.transpose(2, 0, 1))
        (filled,) = session.run(None, {"image": planes[None], "mask": keep[None, None]})
        return np.where(mask[..., None], filled[0].transpose(1, 2, 0), image)

    def _with_rim(self, mask: BoolArray) -> BoolArray:
        """The hole that the network sees; the mask itself where a rim would leave nothing to go by."""
        import cv2

        radius = round(self.options.rim * max(mask.shape))
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
        wider: BoolArray = cv2.dilate(mask.astype(np.uint8), disc) > 0
        return mask if wider.all() else wider
