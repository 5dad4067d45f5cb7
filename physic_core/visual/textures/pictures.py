"""Textures as picture files."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physic_core.types import UInt8Array


def encode_jpeg(image: UInt8Array) -> bytes:
    """Return an image as JPEG."""
    return _encode(image, "JPEG", quality=90)


def encode_png(image: UInt8Array) -> bytes:
    """Return an image as PNG."""
    return _encode(image, "PNG", optimize=True)


def _encode(image: UInt8Array, form: str, **settings: int | bool) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, form, **settings)
    return buffer.getvalue()
