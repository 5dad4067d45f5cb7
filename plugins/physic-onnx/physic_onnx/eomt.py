"""People and the floor by EoMT, one panoptic network."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import Options, Segmenter
from physic_core.weights import fingerprint, locate, missing

from .contract import Match, Wanted, match
from .options import OnnxOptions

if TYPE_CHECKING:
    from physic_core.types import People, UInt8Array

    from .sessions import Network

__all__ = ["Eomt", "EomtOptions"]

MANIFEST = Path(__file__).parent / "weights"
INPUTS = (Wanted("pixel_values", shape=(None, 3, None, None)),)
OUTPUTS = (
    Wanted("class_queries_logits", shape=(None, None, 134)),
    Wanted("masks_queries_logits", shape=(None, None, None, None)),
)
USUAL_SIDE = 640
"""Side of the picture for files that leave it free, px."""


class EomtOptions(OnnxOptions):
    """Settings of Eomt."""

    weights: str = Field(
        "eomt-base", description="a name of `physic weights list`, or the path of a file that you exported"
    )
    score: float = Field(0.5, ge=0, le=1, description="from which a query is heard; 0.8 is sure, 0.3 finds more")
    held: float = Field(
        0.8, ge=0, le=1, description="share of its own mask that a query must win from the others; 0.5 keeps more"
    )
    smallest_px: int = Field(100, ge=1, description="people of fewer pixels are left out")
    floor: bool = Field(
        True, description="answer what people stand on: floors, rugs, roads, pavements, grass, sand ..."
    )


class Eomt(Segmenter):
    """EoMT trained on COCO panoptic: classes of queries say who is a person and what is ground."""

    Options: ClassVar[type[Options]] = EomtOptions
    options: EomtOptions

    def __init__(self, options: EomtOptions | None = None) -> None:
        super().__init__(options)
        self._network: Network | None = None
        self._match: Match | None = None

    def load(self, device: str = "cpu") -> None:
        """Open the network.

        Raises:
            WeightsMissingError: the file is not here; the message says how to get it.
            BackendError: the file is not EoMT for COCO panoptic.
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

    def infer(self, image: UInt8Array) -> People:
        """Image (H, W, 3) -> people, best score first, and the floor.

        Raises:
            InputError: it is no photo.
            BackendError: load() was not called, or the network fails.
        """
        from dataclasses import replace

        import numpy as np

        from physic_core.adapters.panoptic import Padded, people_and_floor
        from physic_core.adapters.pictures import IMAGENET_MEAN, IMAGENET_STD, check_photo, planes, squash

        check_photo(image)
        if self._network is None or self._match is None:
            raise BackendError("EoMT is not loaded: call load() before infer()")
        size = (image.shape[0], image.shape[1])
        side = self._match.inputs["pixel_values"].shape[2]
        padded = Padded(*size, side if isinstance(side, int) else USUAL_SIDE)
        frame = np.zeros((padded.frame, padded.frame, 3), np.uint8)  # black before it is normalised, not after
        frame[: padded.inner[0], : padded.inner[1]] = squash(image, *padded.inner, "bilinear-antialias")
        classes, masks = self._match.run(
            self._network,
            {"pixel_values": planes(frame, IMAGENET_MEAN, IMAGENET_STD)},
            ["class_queries_logits", "masks_queries_logits"],
        )
        people = people_and_floor(
            classes[0],
            masks[0],
            padded.to_photo,
            size,
            threshold=self.options.score,
            held=self.options.held,
            smallest=self.options.smallest_px,
        )
        return people if self.options.floor else replace(people, floor=None)
