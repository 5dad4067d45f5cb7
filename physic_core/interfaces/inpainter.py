"""Interface Inpainter: a photo with the masked pixels replaced by background."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from physic_core.interfaces.backend import Backend, Request
from physic_core.interfaces.checks import check_array

if TYPE_CHECKING:
    from physic_core.types import BoolArray, UInt8Array


@dataclass(frozen=True)
class InpainterRequest(Request["UInt8Array"]):
    """Input of an Inpainter: the photo, and a mask (H, W) bool, True = remove."""

    mask: BoolArray


class Inpainter(Backend):
    """Replaces the masked pixels of a photo by background (paper: OmniEraser)."""

    interface = "inpainter"
    api = 1
    Request = InpainterRequest
    Result = object

    @abstractmethod
    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Replace the pixels where the mask is True; the other pixels and the size stay unchanged.

        The mask is wider than the people by a margin: fill all of it, without blending at its border.

        Example: ``np.where(mask[..., None], filled, image)``, where ``filled`` is the output of a network at the size
        of the image.
        """

    @classmethod
    def check(cls, result: UInt8Array, request: InpainterRequest) -> Iterator[str]:
        """Check that the result is an image of the same size as the input."""
        yield from check_array("image", result, (*request.image.shape[:2], 3), "uint8")
