"""The streams of an AVIF or HEIC file, and the size of AV1 frames, which may be larger than the container promises.

The decoder allocates whole frames and scales them to the size in the container. Boxes follow ISO/IEC 14496-12, and the
units of the stream (OBU) the AV1 Bitstream Specification, sections 5.3 to 5.5.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import BinaryIO

__all__ = ["frame_pixels", "picture_streams"]

_SEQUENCE_HEADER = 1
_FRAMES = (3, 6)  # a frame header, and a header with its frame
_MAX_FRAMES = 9  # the 8 references of a stream, and the frame being decoded
_MAX_UNITS = 100_000  # of all streams together
_METADATA = (b"Exif", b"II*\x00", b"MM\x00*")
_PARENTS = (b"moov", b"trak", b"mdia", b"minf", b"stbl")


def frame_pixels(file: BinaryIO) -> int:
    """Return the most pixels that the decoder holds at once for an image, or 0 without a sequence header.

    Args:
        file: content of an AVIF file.

    Raises:
        ValueError: the boxes or units are damaged, overlap many times or are more than a hundred thousand.
    """
    largest = count = 0
    for stream in _streams_of(file):
        frame = frames = 0
        for kind, unit in _units(stream):
            count += 1
            if kind == _SEQUENCE_HEADER:
                frame = max(frame, _largest_frame(unit))
            frames += kind in _FRAMES
            if count > _MAX_UNITS:
                raise ValueError("too many units")
        largest = max(largest, frame * min(max(frames, 1), _MAX_FRAMES))
    return largest


def picture_streams(file: BinaryIO) -> Iterator[bytes]:
    """Yield the data of each item of an AVIF or HEIC file but EXIF data, and of the first sample of each track.

    Raises:
        ValueError: the boxes are damaged, or items overlap many times.
    """
    return (stream for stream in _streams_of(file) if not any(start in stream[:16] for start in _METADATA))


class _Bits:
    """Unsigned numbers of a box or unit, most significant bit first."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def read(self, count: int) -> int:
        end = self.at + count
        if end > 8 * len(self.data):
            raise ValueError("the data end early")
        part = int.from_bytes(self.data[self.at // 8 : (end + 7) // 8])
        self.at = end
        return part >> (-end % 8) & ((1 << count) - 1)


def _boxes(data: bytes, start: int, end: int) -> Iterator[tuple[bytes, int, int]]:
    """Yield the kind of each box, and where its content starts and ends."""
    while start + 8 <= end:
        size, kind, header = int.from_bytes(data[start : start + 4]), data[start + 4 : start + 8], 8
        if size == 1:
            size, header = int.from_bytes(data[start + 8 : start + 16]), 16
        after = start + max(size, header) if size else end
        yield kind, start + header, min(after, end)
        start = after


def _streams_of(file: BinaryIO) -> Iterator[bytes]:
    file.seek(0)
    data = file.read()
    length = 0
    for stream in _streams(data):
        length += len(stream)
        if length > 4 * len(data):
            raise ValueError("items overlap many times")
        yield stream


def _streams(data: bytes) -> Iterator[bytes]:
    """Yield the data of each item and of the first sample of each track."""
    for kind, start, end in _boxes(data, 0, len(data)):
        if kind == b"meta":
            yield from _items(data, {name: (a, b) for name, a, b in _boxes(data, start + 4, end)})
        elif kind == b"moov":
            yield from _first_samples(data, start, end)


def _items(data: bytes, boxes: dict[bytes, tuple[int, int]]) -> Iterator[bytes]:
    """Yield the data of the items that a box ``iloc`` lists. Those that are no streams have no sequence header."""
    start, end = boxes.get(b"iloc", (0, 0))
    if start == end:
        return
    bits = _Bits(data[start:end])
    version = bits.read(32) >> 24
    offset_size, length_size, base_size, index_size = (8 * bits.read(4) for _ in range(4))
    wide = 32 if version == 2 else 16
    seen: set[tuple[tuple[int, int], ...]] = set()
    count = 0
    for _ in range(bits.read(wide)):
        bits.read(wide)
        within_meta = version > 0 and bits.read(16) & 15 == 1
        bits.read(16)
        base, parts, size = bits.read(base_size), [], 0
        if within_meta:
            base += boxes.get(b"idat", (0, 0))[0]
        extents = bits.read(16)
        count += extents
        if count > _MAX_UNITS:
            raise ValueError("too many extents")
        for _ in range(extents):
            bits.read(index_size if version > 0 else 0)
            place, length = base + bits.read(offset_size), bits.read(length_size)
            stop = min(place + length, len(data)) if length else len(data)
            parts.append((place, stop))
            size += max(0, stop - place)
        if size > len(data):
            raise ValueError("an item is longer than the file")
        if tuple(parts) not in seen:  # tiles of one colour share their data
            seen.add(tuple(parts))
            yield b"".join(data[start:stop] for start, stop in parts)


def _first_samples(data: bytes, start: int, end: int) -> Iterator[bytes]:
    """Yield the first sample of each track."""
    place = size = 0
    for kind, a, b in _boxes(data, start, end):
        if kind in _PARENTS:
            yield from _first_samples(data, a, b)
        elif kind in (b"stco", b"co64"):
            place = int.from_bytes(data[a + 8 : a + (12 if kind == b"stco" else 16)])
        elif kind == b"stsz":
            size = int.from_bytes(data[a + 4 : a + 8]) or int.from_bytes(data[a + 12 : a + 16])
    if place:
        yield data[place : place + size]


def _units(stream: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the type and content of each unit of a stream."""
    at = 0
    while at < len(stream):
        header = stream[at]
        at += 2 if header & 4 else 1
        size = len(stream) - at
        if header & 2:
            size = 0
            for i in range(8):
                byte = stream[at] if at < len(stream) else 0
                at += 1
                size |= (byte & 127) << (7 * i)
                if byte < 128:
                    break
        yield header >> 3 & 15, stream[at : at + size]
        at += size


def _largest_frame(header: bytes) -> int:
    """Return the pixels of the largest frame that a sequence header allows."""
    bits = _Bits(header)
    bits.read(4)
    reduced = bits.read(1)
    if reduced:
        bits.read(5)
    else:
        _skip_operating_points(bits)
    width_bits, height_bits = bits.read(4) + 1, bits.read(4) + 1
    if not reduced:  # a frame may have any size of so many bits, also one above the maximum that follows
        return 1 << (width_bits + height_bits)
    return (bits.read(width_bits) + 1) * (bits.read(height_bits) + 1)


def _skip_operating_points(bits: _Bits) -> None:
    """Read what precedes the size of the frames, unless the header is reduced."""
    delay_bits = 0
    if bits.read(1):  # timing
        bits.read(64)
        if bits.read(1):
            zeros = 0
            while not bits.read(1):
                zeros += 1
            bits.read(zeros)
        if bits.read(1):  # decoder model
            delay_bits = bits.read(5) + 1
            bits.read(42)
    display_delay = bits.read(1)
    for _ in range(bits.read(5) + 1):
        bits.read(12)
        if bits.read(5) > 7:
            bits.read(1)
        if delay_bits and bits.read(1):
            bits.read(2 * delay_bits + 1)
        if display_delay and bits.read(1):
            bits.read(4)
