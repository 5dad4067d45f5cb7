"""Taking people out of a photo with MI-GAN's published pipeline."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import Inpainter, Options
from physic_core.weights import fingerprint, locate, missing

from .contract import Match, Wanted, match
from .options import OnnxOptions

if TYPE_CHECKING:
    from physic_core.types import BoolArray, UInt8Array

    from .sessions import Network

__all__ = ["MiGan", "MiGanOptions"]

MANIFEST = Path(__file__).parent / "weights"
INPUTS = (
    Wanted("image", dtype="uint8", shape=(None, 3, None, None)),
    Wanted("mask", dtype="uint8", shape=(None, 1, None, None)),
)
OUTPUTS = (Wanted("result", dtype="uint8", shape=(None, 3, None, None)),)

NATIVE = 512
"""Side at which the network inside the pipeline works, px."""

CONTEXT = 2.0
"""Side of a crop of its own, in sides of its hole."""


class MiGanOptions(OnnxOptions):
    """Settings of MiGan."""

    weights: str = Field("mi-gan", description="a name of `physic weights list`, or the path of a file of your own")
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


class MiGan(Inpainter):
    """MI-GAN for 512 px in the pipeline that takes photos of any size, and crops them about all holes together.

    It fills what the mask covers: shadows and mirror images of who is removed stay.
    """

    Options: ClassVar[type[Options]] = MiGanOptions
    options: MiGanOptions

    def __init__(self, options: MiGanOptions | None = None) -> None:
        super().__init__(options)
        self._network: Network | None = None
        self._match: Match | None = None

    def load(self, device: str = "cpu") -> None:
        """Open the network.

        Raises:
            WeightsMissingError: the file is not here; the message says how to get it.
            BackendError: the file is not MI-GAN's pipeline.
            DeviceError: the device is not there.
        """
        from .sessions import open_network

        self._attach(open_network(locate(MANIFEST, self.options.weights), self.options, device))

    def _attach(self, network: Network) -> None:
        self._match = match(network, INPUTS, OUTPUTS)
        self._network = network

    def close(self) -> None:
        """Let go of the network."""
        self._network = self._match = None

    def missing(self) -> tuple[str, ...]:
        """The file, if it is not here."""
        return missing(MANIFEST, self.options.weights)

    def fingerprint(self) -> str:
        """What the file is."""
        return fingerprint(MANIFEST, self.options.weights)

    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Image (H, W, 3) and mask (H, W), True = remove -> image, the very same pixels where the mask is False.

        Raises:
            InputError: the image is no photo.
            BackendError: the mask has another size or leaves nothing to go by, or load() was not called.
        """
        import numpy as np

        from physic_core.adapters.pictures import check_photo

        from .holes import check_mask, fill_in_crops, widened

        check_photo(image)
        if self._network is None:
            raise BackendError("MI-GAN is not loaded: call load() before infer()")
        mask = check_mask(image, mask)
        if not mask.any():
            return image.copy()
        hole = widened(mask, self.options.rim)
        if self.options.one_by_one:
            filled = fill_in_crops(image, hole, self._fill, CONTEXT, NATIVE)
        else:
            filled = self._fill(image, hole)
        return np.where(mask[..., None], filled, image)

    def _fill(self, image: UInt8Array, hole: BoolArray) -> UInt8Array:
        """RGB as it is; the pipeline's mask is 255 where the photo is known and 0 in the hole."""
        import numpy as np

        assert self._network is not None
        assert self._match is not None
        feed = {
            "image": np.ascontiguousarray(image.transpose(2, 0, 1))[None],
            "mask": np.where(hole, 0, 255).astype(np.uint8)[None, None],
        }
        (result,) = self._match.run(self._network, feed, ["result"])
        return np.asarray(result[0].transpose(1, 2, 0), np.uint8)
