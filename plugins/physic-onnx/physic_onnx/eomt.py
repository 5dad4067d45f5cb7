"""Segment people, floor and portable objects with EoMT, a panoptic network."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from physic_core.interfaces import Options, Segmenter, Share

from .contract import GraphSignature, PortSpec
from .one_graph import OnnxBackend, OnnxBackendOptions

if TYPE_CHECKING:
    from physic_core.types import People, UInt8Array

__all__ = ["Eomt", "EomtOptions"]

INPUTS = (PortSpec("pixel_values", shape=(None, 3, None, None)),)
OUTPUTS = (
    PortSpec("class_queries_logits", shape=(None, None, 134)),
    PortSpec("masks_queries_logits", shape=(None, None, None, None)),
)
DEFAULT_SIDE = 640
"""Input side for files of free size, px."""


class EomtOptions(OnnxBackendOptions):
    """Settings of Eomt."""

    weights: str = Field(
        "eomt-base", description="a name of `physic weights list`, or the path of a file that you exported"
    )
    score: Share = Field(0.5, description="from which a query is heard; 0.8 is sure, 0.3 finds more")
    held: Share = Field(0.8, description="share of its own mask that a query must win from the others; 0.5 keeps more")
    smallest_px: int = Field(100, ge=1, le=100_000, description="people of fewer pixels are left out")
    floor: bool = Field(
        True, description="answer what people stand on: floors, rugs, roads, pavements, grass, sand ..."
    )


class Eomt(OnnxBackend, Segmenter):
    """Segmenter by EoMT, trained on COCO panoptic. Its classes include people, floors and things."""

    Options: ClassVar[type[Options]] = EomtOptions
    options: EomtOptions
    signatures: ClassVar = {"EoMT of COCO panoptic": GraphSignature(INPUTS, OUTPUTS)}

    def infer(self, image: UInt8Array) -> People:
        """Segment the people of an image (H, W, 3), best score first, the floor, and portable objects.

        Raises:
            InputError: it is no photo.
            BackendError: load() was not called, or the network fails.
        """
        from dataclasses import replace

        from physic_core.adapters.panoptic import PaddedFrame, padded_input, people_and_floor

        from .top_down import size_or_default

        loaded = self.loaded()
        size = (image.shape[0], image.shape[1])
        padded = PaddedFrame(*size, size_or_default(loaded.input_shape("pixel_values")[2], DEFAULT_SIDE))
        classes, masks = loaded.run_image(
            "pixel_values", padded_input(image, padded), "class_queries_logits", "masks_queries_logits"
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
