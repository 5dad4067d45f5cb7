"""How much memory an image file takes while it is decoded, from its header."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, BinaryIO

if TYPE_CHECKING:
    from PIL import Image

__all__ = ["check_parts", "decoding_bytes"]

_MAX_PARTS = 10_000
"""Maximum number of segments, chunks or tags before the pixels. Pillow takes up to 200 bytes for each."""

_MAX_NUMBERS = 2_000_000
"""Maximum number of values of the tags of a TIFF file. Pillow takes up to 400 bytes for each."""

_LOST_BLOCK = 4096
"""Zeros that a lossy WebP has at a lost block, bytes. One colour in 12 megapixels gives up to 1,140."""

_LOST_SECTOR = 512
"""Zeros that a picture of AVIF or HEIC has at a lost sector of a disk, bytes. HEVC forbids three; AV1 needs no 64."""

_TIFF_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8}
"""TIFF type -> bytes of a value."""
_TIFF_TEXTS = (1, 2, 6, 7)  # types whose values Pillow keeps as bytes
_TIFF_FOLDERS = (34665, 34853, 40965)  # tags of further directories: Exif, GPS, interoperability
_TILE_WIDTH, _TILE_HEIGHT, _STRIP_HEIGHT = 322, 323, 278


def decoding_bytes(image: Image.Image, file: BinaryIO) -> int:
    """Return the most bytes that decoding takes, with the decoded image, for an image that is open and not decoded.

    The bytes per pixel were measured on files of 48 Mpx, and are rounded up.

    Args:
        image: opened by Pillow.
        file: its content.

    Raises:
        Exception: the header is damaged.
    """
    pixels = image.size[0] * image.size[1]
    channels = len(image.getbands())
    stored = pixels * _bytes_per_pixel(image)
    match image.format:
        case "JPEG" | "MPO":  # a progressive file: coefficients of 2 bytes, and the image, from 25 Mpx on reduced
            return 2 * channels * pixels + (stored if pixels < 25e6 else stored // 4)
        case "WEBP":
            return 17 * pixels
        case "AVIF":  # with 12 bits a channel; a frame larger than the image is scaled before it is converted
            from physic_core.files.av1_frame import frame_pixels

            return max(22 * pixels, 9 * frame_pixels(file))
        case "HEIF":
            return 12 * pixels
        case "JPEG2000":
            return stored + 7 * max(channels, 3) * int(min(pixels, _jpeg2000_tile(file)))
        case "TIFF":  # turned upright by Pillow, which takes a copy
            tile = 2 * _tiff_tile(image) * channels * _bytes_per_pixel(image)
            return 2 * stored + tile
        case _:
            return stored + pixels


def check_parts(kind: str, file: BinaryIO) -> None:
    """Raise ValueError if a file has so many parts that reading them takes much memory or time, or lacks some.

    Args:
        kind: "AVIF", "HEIF", "JPEG", "PNG", "TIFF" or "WEBP"; others are not checked.
        file: its content.

    Raises:
        ValueError: the header has too many parts, or a picture has lost a block.
        Exception: the header is damaged.
    """
    check = _PARTS.get(kind)
    if check is not None:
        check(file)


def _bytes_per_pixel(image: Image.Image) -> int:
    """Return the size of a pixel in Pillow's memory."""
    return {"1": 1, "L": 1, "P": 1}.get(image.mode, 2 if image.mode.startswith("I;16") else 4)


def _jpeg2000_tile(file: BinaryIO) -> float:
    """Return the pixels of a tile of a JPEG 2000 file, from the marker SIZ of its codestream; inf if there is none."""
    place, kind, header = 0, b"", 0
    file.seek(0)
    if file.read(4) != b"\xff\x4f\xff\x51":
        for _ in range(_MAX_PARTS):  # boxes, until that of the codestream
            file.seek(place)
            head = file.read(16)
            size, kind = int.from_bytes(head[:4]), head[4:8]
            header = 16 if size == 1 else 8
            if kind == b"jp2c" or len(head) < 16:
                break
            place += max(8, int.from_bytes(head[8:]) if size == 1 else size)
        if kind != b"jp2c":
            return math.inf
    file.seek(place + header)
    width, height = map(float, struct.unpack_from(">II", file.read(32), 24))
    return width * height


def _tiff_tile(image: Any) -> int:
    """Return the pixels of a tile or strip of a TIFF image."""
    tags = image.tag_v2
    if _TILE_WIDTH in tags or _TILE_HEIGHT in tags:
        return int(tags[_TILE_WIDTH]) * int(tags[_TILE_HEIGHT])
    # Pillow has swapped the sides of an image to be turned.
    width, height = image.size
    rows = int(tags.get(_STRIP_HEIGHT, height))
    return int(min(width * height, max(width, height) * rows))


def _check_jpeg(file: BinaryIO) -> None:
    """Walk over the segments before the picture."""
    place = 2
    for _ in range(_MAX_PARTS):
        file.seek(place)
        head = file.read(1 << 12)
        marker = head.lstrip(b"\xff")
        if not head.startswith(b"\xff"):  # bytes between segments, which Pillow skips
            place += max(1, head.find(b"\xff") if b"\xff" in head else len(head))
        elif marker and (marker[0] in (0x00, 0x01) or 0xD0 <= marker[0] <= 0xD8):  # without a length
            place += len(head) - len(marker) + 1
        elif len(marker) >= 3 and marker[0] != 0xDA:
            place += len(head) - len(marker) + 1 + struct.unpack_from(">H", marker, 1)[0]
        elif marker:
            return
        else:
            place += len(head)
        if not head:
            return
    raise ValueError(f"more than {_MAX_PARTS} segments before the picture")


def _check_png(file: BinaryIO) -> None:
    """Walk over the chunks."""
    file.seek(8)
    count = 0
    while len(head := file.read(8)) == 8:
        count += head[4:] not in (b"IDAT", b"fdAT", b"fcTL")
        if count > _MAX_PARTS:
            raise ValueError(f"more than {_MAX_PARTS} chunks")
        file.seek(struct.unpack(">I", head[:4])[0] + 4, 1)


def _check_webp(file: BinaryIO) -> None:
    """Find a lost block of a disk or a download in the picture; its codes have no checksum, and any bytes decode."""
    file.seek(12)
    while len(head := file.read(8)) == 8:
        size = int.from_bytes(head[4:], "little")
        if head[:4] == b"VP8 ":
            if bytes(_LOST_BLOCK) in file.read(size):
                raise ValueError(f"{_LOST_BLOCK} bytes of zeros in the picture")
            return
        file.seek(size + size % 2, 1)


def _check_items(file: BinaryIO) -> None:
    """Find a lost sector in the pictures, for which decoders invent pixels without a word."""
    from physic_core.files.av1_frame import picture_streams

    if any(bytes(_LOST_SECTOR) in stream for stream in picture_streams(file)):
        raise ValueError(f"{_LOST_SECTOR} bytes of zeros in the picture")


def _check_tiff(file: BinaryIO) -> None:
    """Count the values of the tags of the first image."""
    file.seek(0)
    head = file.read(16)
    order = "<" if head[:2] == b"II" else ">"
    big = 43 in (head[2], head[3])
    # Formats of: the number of tags; a tag's number, type and count; the size of its value or offset.
    count_format, tag_format, value = (f"{order}Q", f"{order}HHQ", 8) if big else (f"{order}H", f"{order}HHL", 4)
    offset_format = f"{order}Q" if big else f"{order}L"
    folders = [struct.unpack_from(offset_format, head, 8 if big else 4)[0]]
    numbers = 0
    for place in folders:
        try:
            file.seek(place)
            tags = struct.unpack(count_format, file.read(struct.calcsize(count_format)))[0]
        except (struct.error, OSError, OverflowError):
            continue  # Pillow refuses a file without its first directory, and reads one without the others
        if tags > _MAX_PARTS:
            raise ValueError(f"{tags} tags")
        size = struct.calcsize(tag_format) + value
        entries = file.read(size * tags)
        for at in range(0, len(entries) - size + 1, size):
            tag, kind, count = struct.unpack_from(tag_format, entries, at)
            if kind not in _TIFF_TEXTS and kind in _TIFF_SIZES:
                numbers += count
            if place == folders[0] and tag in _TIFF_FOLDERS and len(folders) <= len(_TIFF_FOLDERS):
                folders.append(struct.unpack_from(offset_format, entries, at + size - value)[0])
    if numbers > _MAX_NUMBERS:
        raise ValueError(f"tags with {numbers} values")


_PARTS: dict[str, Callable[[BinaryIO], None]] = {
    "AVIF": _check_items,
    "HEIF": _check_items,
    "JPEG": _check_jpeg,
    "PNG": _check_png,
    "TIFF": _check_tiff,
    "WEBP": _check_webp,
}
