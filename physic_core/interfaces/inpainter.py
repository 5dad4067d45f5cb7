"""Interface Inpainter: the photo without its people."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from physic_core.interfaces.backend import Backend, Request
from physic_core.interfaces.checks import check_array

if TYPE_CHECKING:
    from physic_core.types import BoolArray, UInt8Array

__all__ = ["Inpainter", "InpainterRequest"]


@dataclass(frozen=True)
class InpainterRequest(Request["UInt8Array"]):
    """What an Inpainter is given.

    Attributes:
        image: (H, W, 3) uint8 RGB, the photo.
        mask: (H, W) bool, True = remove.
    """

    mask: BoolArray


class Inpainter(Backend):
    """Removes people from a photo (paper: OmniEraser)."""

    interface = "inpainter"
    api = 1
    Request = InpainterRequest
    Result = object

    @abstractmethod
    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Image (H, W, 3) and mask (H, W), True = remove -> image of that size, unchanged where the mask is False."""

    @classmethod
    def check(cls, result: UInt8Array, request: InpainterRequest) -> Iterator[str]:
        """An image of the size that was given."""
        yield from check_array("image", result, (*request.image.shape[:2], 3), "uint8")
