"""Remove people from a photo with MI-GAN."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.inpainting import inpaint_masked
from physic_core.interfaces import Inpainter, Options
from physic_embedded.networks.sessions import PackagedNetworks

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
    threads: int = Field(default=2, ge=0, le=256, description="Threads inside one operator; 0 lets onnxruntime choose.")


class MiGan(Inpainter):
    """MI-GAN inpainter for 512 px, trained on Places2. It runs on a crop around the hole, for any photo size.

    The fill is sharp for holes up to about 512 px across and gets blurred above that. Where little but hole is left, it
    is imagination. A hole that is much larger than the person invites invented figures, so dilate little: 0.4 to 1.2 %
    of the photo's long side.
    """

    Options: ClassVar[type[Options]] = MiGanOptions
    options: MiGanOptions

    def __init__(self, options: MiGanOptions | None = None) -> None:
        super().__init__(options)
        self._networks = PackagedNetworks("migan_512_places2")

    def load(self, device: str = "cpu") -> None:
        """Open the network.

        Raises:
            DeviceError: the device is not there.
        """
        self._networks.open(device, self.options.threads)

    def close(self) -> None:
        """Close the network."""
        self._networks.close()

    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Fill the mask (H, W), True = remove, in an image (H, W, 3); pixels outside the mask stay identical.

        Raises:
            BackendError: the mask has another size, or leaves nothing to go by.
        """
        return inpaint_masked(image, mask, self.options.rim, self._fill)

    def _fill(self, image: UInt8Array, hole: BoolArray) -> UInt8Array:
        """Run the network; its mask input is 255 where the photo is known and 0 in the hole."""
        planes = np.ascontiguousarray(image.transpose(2, 0, 1))
        known = np.where(hole, 0, 255).astype(np.uint8)
        (filled,) = self._networks["migan_512_places2"].run(None, {"image": planes[None], "mask": known[None, None]})
        return np.asarray(filled[0].transpose(1, 2, 0))
