"""Textures as picture files."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def encode_image(image: NDArray[np.uint8 | np.uint16], form: Literal["JPEG", "PNG"]) -> bytes:
    """Return an image (H, W, 3) or (H, W) as a file; a PNG of (H, W) may have 16 bits."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, form, **({"quality": 90} if form == "JPEG" else {"optimize": True}))
    return buffer.getvalue()
