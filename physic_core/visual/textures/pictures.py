"""Textures as picture files."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from physic_core.types import UInt8Array


def encode_image(image: UInt8Array, form: Literal["JPEG", "PNG"]) -> bytes:
    """Return an image (H, W, 3) or (H, W) as a file."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, form, **({"quality": 90} if form == "JPEG" else {"optimize": True}))
    return buffer.getvalue()
