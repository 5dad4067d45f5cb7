"""Real photos as files of each kind, and what disks, downloads and copies do to them."""

from __future__ import annotations

import io
import struct
from functools import cache
from pathlib import Path

from PIL import Image

from physic_core.io.photo import read_photo

PHOTO = Path(__file__).parents[2] / "examples" / "basketball.png"
BLOCK = 4096

KINDS = {
    "baseline": ("JPEG", {"quality": 90}),
    "fine": ("JPEG", {"quality": 98}),
    "optimised": ("JPEG", {"quality": 90, "optimize": True}),
    "progressive": ("JPEG", {"quality": 90, "progressive": True}),
    "restarts": ("JPEG", {"quality": 90, "restart_marker_rows": 1}),
    "grey": ("JPEG", {"quality": 90}),
    "png": ("PNG", {}),
    "webp": ("WEBP", {"quality": 90}),
}
"""Name -> format and options."""


@cache
def encoded(kind):
    file = io.BytesIO()
    image = Image.open(PHOTO).convert("L" if kind == "grey" else "RGB")
    image.save(file, KINDS[kind][0], **KINDS[kind][1])
    return file.getvalue()


@cache
def pixels(kind):
    """What the undamaged file is read as, (H, W, 3) uint8."""
    return read_photo(encoded(kind)).image


def zeros(data, at):
    """A block that a disk has lost, or that a download has not filled."""
    return data[:at] + bytes(BLOCK) + data[at + BLOCK :]


def cut(data, at):
    """The end is missing, and something has put the end marker back and corrected the sizes."""
    match data[:4]:
        case b"\x89PNG":
            return data[:at] + data[-12:]
        case b"RIFF":
            at -= at % 2
            return (
                data[:4]
                + struct.pack("<I", at - 8)
                + data[8:16]
                + struct.pack("<I", at - 20)
                + data[20:at]
            )
        case _:
            return data[:at] + b"\xff\xd9"


def picture_start(data):
    """Where the codes of the picture begin, about."""
    return data.rindex(b"\xff\xda", 0, 2000) + 20 if data.startswith(b"\xff\xd8") else 200
