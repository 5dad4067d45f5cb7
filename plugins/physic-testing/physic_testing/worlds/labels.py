"""World name and seed, hidden in the lowest bits of the corner pixels of a photo.

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

_FIELDS = struct.Struct(f">4s{LONGEST_NAME}sQ")  # magic, name padded with zeros, seed
_CHECKSUM = struct.Struct(">I")
_MAGIC = b"PhWl"
_BITS = 8 * (_FIELDS.size + _CHECKSUM.size)
_SIDE = 12  # px; three bits a pixel hold the label
SMALLEST_PX = 2 * _SIDE
"""Minimum width and height of a photo with labels, so that its corners do not overlap."""


def embed_label(image: UInt8Array, name: str, seed: int) -> UInt8Array:
    """Return a copy of the image with the label in each corner; no channel changes by more than one
    grey level.

    Args:
        image: (H, W, 3) uint8, at least SMALLEST_PX high and wide.
        name: of the world, at most LONGEST_NAME bytes, without zero bytes.
        seed: of the world, in [0, 2^64).

    Raises:
        InputError: the image, the name or the seed does not fit.
    """
    text = name.encode()
    if not 0 < len(text) <= LONGEST_NAME or 0 in text:
        raise InputError(
            f"A label holds a name of 1 to {LONGEST_NAME} bytes without zeros, got {name!r}."
        )
    if not 0 <= seed < 2**64:
        raise InputError(f"A label holds a seed from 0 to 2^64 - 1, got {seed}.")
    if not _holds_labels(image):
        raise InputError(
            f"A label needs an image of 8-bit RGB of at least {SMALLEST_PX} x {SMALLEST_PX} px, "
            f"got {image.dtype} of shape {image.shape}."
        )
    fields = _FIELDS.pack(_MAGIC, text, seed)
    label = np.frombuffer(fields + _CHECKSUM.pack(zlib.crc32(fields)), np.uint8)
    bits = np.zeros(_SIDE * _SIDE * 3, np.uint8)
    bits[:_BITS] = np.unpackbits(label)
    stamped = image.copy()
    for rows, columns in _corners():
        stamped[rows, columns] = (stamped[rows, columns] & 0xFE) | bits.reshape(_SIDE, _SIDE, 3)
    return stamped


def read_label(image: UInt8Array) -> tuple[str, int] | None:
    """Return the world name and seed of an image's label; None without a valid label, or if two
    corners differ.
    """
    if not _holds_labels(image):
        return None
    found = {
        label
        for rows, columns in _corners()
        if (label := _decode(image[rows, columns])) is not None
    }
    return found.pop() if len(found) == 1 else None


def _decode(corner: UInt8Array) -> tuple[str, int] | None:
    """Return the name and seed of one corner's label; None if it is invalid."""
    label = np.packbits((corner & 1).reshape(-1)[:_BITS]).tobytes()
    fields = label[: _FIELDS.size]
    checksum = label[_FIELDS.size :]
    magic, text, seed = _FIELDS.unpack(fields)
    if magic != _MAGIC or _CHECKSUM.unpack(checksum)[0] != zlib.crc32(fields):
        return None
    return text.rstrip(b"\0").decode(), seed


def _corners() -> list[tuple[slice, slice]]:
    """Return the row and column slices of the four corners."""
    ends = (slice(None, _SIDE), slice(-_SIDE, None))
    return [(rows, columns) for rows in ends for columns in ends]


def _holds_labels(image: UInt8Array) -> bool:
    """Return whether an image is 8-bit RGB and large enough for labels."""
    return (
        image.dtype == np.uint8
        and image.ndim == 3
        and image.shape[2] == 3
        and min(image.shape[:2]) >= SMALLEST_PX
    )
