"""A segmenter that hangs, aborts or raises on the photos that its options name; for ``batch_faults.py``."""

from __future__ import annotations

import hashlib
import os
import time
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from physic_core.interfaces import Options
from physic_mock.pixels import MockSegmenter, SegmenterOptions

if TYPE_CHECKING:
    from physic_core.types import People, UInt8Array


class FaultyOptions(SegmenterOptions):
    """Digests of images, by what happens to them."""

    hang: tuple[str, ...] = Field((), description="never return")
    abort: tuple[str, ...] = Field((), description="end the process by SIGABRT")
    fail: tuple[str, ...] = Field((), description="raise an error")


class FaultySegmenter(MockSegmenter):
    """The mock segmenter with faults."""

    Options: ClassVar[type[Options]] = FaultyOptions
    options: FaultyOptions

    def infer(self, image: UInt8Array) -> People:
        """Segment a world's photo, unless its digest is in the options."""
        digest = pixels_digest(image)
        if digest in self.options.abort:
            os.abort()
        if digest in self.options.fail:
            raise RuntimeError("this photo is in 'fail'")
        while digest in self.options.hang:
            time.sleep(1)
        return super().infer(image)


def pixels_digest(image: UInt8Array) -> str:
    """Return the SHA-256 of the pixels of an image (H, W, 3)."""
    return hashlib.sha256(image.tobytes()).hexdigest()
