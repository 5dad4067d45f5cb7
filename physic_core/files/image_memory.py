"""How much memory an image file takes while it is decoded, by the size and format in its header."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from PIL import Image


def decoding_bytes(image: Image.Image) -> int:
    """Return the most bytes that decoding takes, with the decoded image, for an image that is open and not decoded.

    The bytes per pixel were measured on files of 16 and 48 Mpx, and are rounded up. A file whose tiles or frames are
    larger than its image takes more.

    Args:
        image: opened by Pillow.
    """
    pixels = image.size[0] * image.size[1]
    channels = len(image.getbands())
    stored = pixels * _bytes_per_pixel(image.mode)
    match image.format:
        case "JPEG" | "MPO":  # a progressive file: coefficients of 2 bytes, and the image, from 25 Mpx on reduced
            return 2 * channels * pixels + (stored if pixels < 25e6 else stored // 4)
        case "WEBP":
            return 17 * pixels
        case "AVIF":  # with 12 bits a channel
            return 22 * pixels
        case "HEIF":
            return 12 * pixels
        case "JPEG2000":  # of one tile
            return stored + 7 * max(channels, 3) * pixels
        case "TIFF":  # of one strip, and turned upright by Pillow, which takes a copy
            return 3 * stored
        case _:
            return stored + pixels


def _bytes_per_pixel(mode: str) -> int:
    """Return the size of a pixel in Pillow's memory."""
    return {"1": 1, "L": 1, "P": 1}.get(mode, 2 if mode.startswith("I;16") else 4)
