"""Remove people from a photo with MI-GAN's published ONNX pipeline."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.interfaces import Inpainter, Options

from .contract import GraphSignature, PortSpec
from .one_graph import WEIGHTS_HELP, OnnxBackend, OnnxBackendOptions

if TYPE_CHECKING:
    from physic_core.types import BoolArray, UInt8Array

INPUTS = (
    PortSpec("image", dtype="uint8", shape=(None, 3, None, None)),
    PortSpec("mask", dtype="uint8", shape=(None, 1, None, None)),
)
OUTPUTS = (PortSpec("result", dtype="uint8", shape=(None, 3, None, None)),)

NATIVE = 512
"""Input side of the network inside the pipeline, px."""

CONTEXT = 2.0
"""Side of a hole's crop over the side of the hole."""


class MiGanOptions(OnnxBackendOptions):
    """Settings of MiGan."""

    weights: str = Field("mi-gan", description=WEIGHTS_HELP)
    rim: float = Field(
        0.004,
        ge=0,
        le=0.1,
        description="share of the long side by which the network's hole is wider than what is filled: at the edge its "
        "fill takes on the colours of what is removed; 0.004-0.012, more invites invented figures",
    )
    one_by_one: bool = Field(
        False,
        description="show each hole in a crop of its own: more detail where people are far apart, and more inventions",
    )


class MiGan(OnnxBackend, Inpainter):
    """MI-GAN inpainter for 512 px. The ONNX file takes photos of any size and crops them around all holes.

    Shadows and mirror images of removed people stay, unless the mask covers them.
    """

    Options: ClassVar[type[Options]] = MiGanOptions
    options: MiGanOptions
    signatures: ClassVar = {"MI-GAN's pipeline": GraphSignature(INPUTS, OUTPUTS)}

    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Fill the mask (H, W), True = remove, in an image (H, W, 3); pixels outside the mask stay identical.

        Raises:
            InputError: the image is not a valid photo.
            BackendError: the mask has another size or leaves nothing to go by, or load() was not called.
        """
        from physic_core.adapters.inpainting import inpaint_masked

        from .holes import inpaint_in_crops

        self.loaded()

        def one_by_one(image: UInt8Array, hole: BoolArray) -> UInt8Array:
            return inpaint_in_crops(image, hole, self._fill, CONTEXT, NATIVE)

        return inpaint_masked(image, mask, self.options.rim, one_by_one if self.options.one_by_one else self._fill)

    def _fill(self, image: UInt8Array, hole: BoolArray) -> UInt8Array:
        """Run the pipeline; its mask input is 255 where the photo is known and 0 in the hole."""

        loaded = self.loaded()
        feed = {
            "image": np.ascontiguousarray(image.transpose(2, 0, 1))[None],
            "mask": np.where(hole, 0, 255).astype(np.uint8)[None, None],
        }
        (result,) = loaded.ports.run(loaded.network, feed, ["result"])
        return np.asarray(result[0].transpose(1, 2, 0), np.uint8)
