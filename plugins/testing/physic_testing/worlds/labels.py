"""World name, hidden in the lowest bits of the corner pixels of a photo.

Each corner contains the complete label, so that one remains if the others are inpainted. Lossy
compression destroys the label, which its checksum detects.
"""

from __future__ import annotations

import struct
import zlib
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError

if TYPE_CHECKING:
    from physic_core.types import UInt8Array

__all__ = ["LONGEST_NAME", "SMALLEST_PX", "embed_label", "read_label"]

LONGEST_NAME = 32
"""Maximum length of a name, bytes of UTF-8."""

_LABEL = struct.Struct(f">4s{LONGEST_NAME}sI")  # magic, name padded with zeros, checksum of both
_MAGIC = b"PhW2"
_SIDE = 11  # px; three bits a pixel hold the label
SMALLEST_PX = 2 * _SIDE
"""Minimum width and height of a photo with labels, so that its corners do not overlap."""


def embed_label(image: UInt8Array, name: str) -> UInt8Array:
    """Return a copy of the image with the label in each corner, which changes no channel by more
    than one grey level.

    Args:
        image: (H, W, 3) uint8, at least SMALLEST_PX high and wide.
        name: of the world, at most LONGEST_NAME bytes, without zero bytes.

    Raises:
        InputError: the image or the name does not fit.
    """
    text = name.encode()
    if not 0 < len(text) <= LONGEST_NAME or 0 in text:
        raise InputError(
            f"A label holds a name of 1 to {LONGEST_NAME} bytes without zeros, got {name!r}."
        )
    if not _holds_labels(image):
        raise InputError(
            f"A label needs an image of 8-bit RGB of at least {SMALLEST_PX} x {SMALLEST_PX} px, "
            f"got {image.dtype} of shape {image.shape}."
        )
    checksum = zlib.crc32(_MAGIC + text)
    label = np.frombuffer(_LABEL.pack(_MAGIC, text, checksum), np.uint8)
    bits = np.zeros(_SIDE * _SIDE * 3, np.uint8)
    bits[: 8 * _LABEL.size] = np.unpackbits(label)
    stamped = image.copy()
    for rows, columns in _corners():
        stamped[rows, columns] = (stamped[rows, columns] & 0xFE) | bits.reshape(_SIDE, _SIDE, 3)
    return stamped


def read_label(image: UInt8Array) -> str:
    """Return the name in an image's label; "" without a valid label, or if two corners differ."""
    if not _holds_labels(image):
        return ""
    names = {_decode(image[rows, columns]) for rows, columns in _corners()} - {""}
    return names.pop() if len(names) == 1 else ""


def _decode(corner: UInt8Array) -> str:
    """Return the name of one corner's label; "" if it is invalid."""
    label = np.packbits((corner & 1).reshape(-1)[: 8 * _LABEL.size]).tobytes()
    magic, padded, checksum = _LABEL.unpack(label)
    text = padded.rstrip(b"\0")
    return text.decode() if magic == _MAGIC and checksum == zlib.crc32(magic + text) else ""


def _corners() -> list[tuple[slice, slice]]:
    """Return the row and column slices of the four corners."""
    ends = (slice(None, _SIDE), slice(-_SIDE, None))
    return [(rows, columns) for rows in ends for columns in ends]


def _holds_labels(image: UInt8Array) -> bool:
    """Return whether an image is 8-bit RGB and large enough for labels."""
    is_rgb = image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3
    return is_rgb and min(image.shape[:2]) >= SMALLEST_PX
