"""Find data that are lost inside a JPEG file. Decoders invent pixels for them, and Pillow drops their warnings."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import BinaryIO

import simplejpeg

MAX_SCANS = 500
"""Maximum number of scans. Cameras and editors write up to about 20; each takes the time of a complete picture."""

MAX_JPEG_BYTES = 400_000_000
"""Maximum size of a JPEG file."""

_MAX_PADDING = 64
"""Encoders in cameras fill the end of the picture data up to a multiple of some bytes."""

_LOST_BLOCK = 256
"""Zeros that no picture has, bytes; a lost block of a disk or a download has 512 or more."""

_MARKER = re.compile(rb"\xff([^\x00\xff\xd0-\xd7])")  # of a segment: not of an 0xff in the picture, nor of a restart
_SOI, _EOI, _SOS, _TEM, _DHT = 0xD8, 0xD9, 0xDA, 0x01, 0xC4
_SEQUENTIAL = (0xC0, 0xC1)  # frames without refinement, in which zeros can be bits of many pixels
_EXTRA = re.compile(r"Corrupt JPEG data: (\d+) extraneous bytes before marker 0xd9")


def check_jpeg_data(file: BinaryIO) -> None:
    """Raise ValueError if data of the picture are missing or damaged, by decoding it at an eighth of its size.

    libjpeg-turbo, which Pillow uses too, warns where the codes of the picture and its size disagree. Damage that leaves
    as many codes as before, such as a changed bit, gives no warning. So lost blocks of zeros are looked for, too.

    Args:
        file: the content of a JPEG file.

    Raises:
        ValueError: data are missing, there are more than ``MAX_SCANS`` scans or ``MAX_JPEG_BYTES``, or the sampling of
            the colours is of a kind that libjpeg-turbo cannot name.
    """
    size = file.seek(0, 2)
    if size > MAX_JPEG_BYTES:
        raise ValueError(f"a JPEG of {size} bytes")
    data = bytearray(size)
    file.seek(0)
    file.readinto(data)  # type: ignore[attr-defined]
    tables, scans, end, huffman, sequential = bytearray((0xFF, _SOI)), [], size, b"", False
    for marker, start, stop in _segments(data):
        if marker == _EOI:
            end = start
        elif marker == _SOS:
            scans.append(start)
        elif not scans and (0xC0 <= marker <= 0xCF or marker in (0xDB, 0xDD)):
            tables += data[start:stop]
            sequential |= marker in _SEQUENTIAL
            if marker == _DHT:
                huffman += data[start + 4 : stop]
        if len(scans) > MAX_SCANS:
            raise ValueError(f"more than {MAX_SCANS} scans")
    if not scans:
        raise ValueError("no picture")
    one_scan = sequential and len(scans) == 1
    if one_scan and not _zeros_can_be_plain(huffman) and data.find(bytes(_LOST_BLOCK), scans[0], end) >= 0:
        raise ValueError(f"{_LOST_BLOCK} bytes of zeros in the picture")
    # The tables alone, right before the picture: harmless oddities of other segments would be the only warning.
    begin = scans[0] - len(tables)
    data[begin : scans[0]] = tables
    try:
        simplejpeg.decode_jpeg(memoryview(data)[begin:], "GRAY", min_height=1, min_width=1, min_factor=8)
    except ValueError as error:
        extra = _EXTRA.fullmatch(str(error))
        count = int(extra[1]) if extra else size
        if count > _MAX_PADDING or data[end - count : end].strip(b"\x00\xff"):
            raise


def _zeros_can_be_plain(huffman: bytes) -> bool:
    """Return whether zeros end each block, as optimised tables of pictures with large plain areas have it."""
    place = 0
    while place < len(huffman):  # class and number of a table, 16 counts of codes, and a symbol for each code
        if huffman[place] >= 0x10 and huffman[place + 17 : place + 18] != b"\x00":
            return False
        place += 17 + sum(huffman[place + 1 : place + 17])
    return True


def _segments(data: bytearray) -> Iterator[tuple[int, int, int]]:
    """Yield marker, start and end of each segment, up to the end of the picture; a scan's ends before its codes."""
    place = 2
    while found := _MARKER.search(data, place):
        marker, place = found[1][0], found.end()
        if marker not in (_SOI, _EOI, _TEM):  # these have no length
            place += max(2, int.from_bytes(data[place : place + 2]))
        yield marker, found.start(), place
        if marker == _EOI:
            return
