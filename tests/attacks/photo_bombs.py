"""Small image files that take gigabytes or minutes if their header is believed, and what reading
them gives.
"""

from __future__ import annotations

import io
import struct
import zlib

from PIL import Image

SIDE = 12_000
"""Of an image below the limit of 150 megapixels, px."""

DAMAGED = "its data are damaged or truncated"


def encoded(kind, mode="RGB", **options):
    file = io.BytesIO()
    Image.new(mode, (64, 64)).save(file, kind, **options)
    return bytearray(file.getvalue())


def webp():
    """34 bytes."""
    picture = b"\x2f" + struct.pack("<I", (SIDE - 1) | (SIDE - 1) << 14) + bytes(9)
    return (
        b"RIFF"
        + struct.pack("<I", 12 + len(picture))
        + b"WEBPVP8L"
        + struct.pack("<I", len(picture))
        + picture
    )


def jpeg2000():
    """One tile of 144 megapixels."""
    data = encoded("JPEG2000")
    sizes = data.index(b"\xff\x4f\xff\x51") + 8
    header = data.index(b"ihdr") + 4
    data[header : header + 8] = struct.pack(">II", SIDE, SIDE)
    for at in (sizes, sizes + 16):
        data[at : at + 8] = struct.pack(">II", SIDE, SIDE)
    return bytes(data)


def jpeg():
    """144 megapixels, of which the file has the first 64 x 64."""
    data = encoded("JPEG")
    at = data.index(b"\xff\xc0") + 5
    data[at : at + 4] = struct.pack(">HH", SIDE, SIDE)
    return bytes(data[:-2])


def jpeg_with(segment, count):
    data = encoded("JPEG")
    return bytes(data[:2]) + segment * count + bytes(data[2:])


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def palette_png():
    """144 megapixels of one transparent colour. The same block of compressed zeros is repeated."""
    compressor = zlib.compressobj(9)
    begin, block = (
        compressor.compress(bytes(SIDE + 1)) + compressor.flush(zlib.Z_FULL_FLUSH) for _ in range(2)
    )
    header = struct.pack(">IIBBBBB", SIDE, SIDE, 8, 3, 0, 0, 0)
    colours = chunk(b"PLTE", bytes(768)) + chunk(b"tRNS", bytes(9))
    picture = chunk(b"IDAT", begin + block * (SIDE - 1) + b"\x03\x00")
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + colours + picture + chunk(b"IEND", b"")


def png_with(*chunks):
    data = bytes(encoded("PNG"))
    return data[:33] + b"".join(chunks) + data[33:]


def tiff(side, tags, after=b"", following=0):
    """A grey image whose further tags are (tag, type, count, value)."""
    rows = [
        (256, 4, 1, side),
        (257, 4, 1, side),
        (258, 3, 1, 8),
        (262, 3, 1, 1),
        (277, 3, 1, 1),
        *tags,
    ]
    table = b"".join(struct.pack("<HHLL", *row) for row in sorted(rows))
    return (
        b"II*\x00" + struct.pack("<LH", 8, len(rows)) + table + struct.pack("<L", following) + after
    )


def huge_tile():
    """A tile of 2.1 gigapixels for an image of 64 x 64 px."""
    place = 8 + 2 + 12 * 10 + 4
    data = zlib.compress(bytes(1000))
    tile = [
        (322, 4, 1, 46_000),
        (323, 4, 1, 46_000),
        (324, 4, 1, place),
        (325, 4, 1, len(data)),
        (259, 3, 1, 8),
    ]
    return tiff(64, tile, data)


def many_frames():
    """A hundred thousand images, of which one is used."""
    count = 100_000
    size = 2 + 12 * 8 + 4
    strip = [(273, 4, 1, 8), (278, 4, 1, 64), (279, 4, 1, 4096)]
    first = tiff(64, strip, following=8 + size)
    frame = first[8:-4]
    more = b"".join(frame + struct.pack("<L", 8 + size * (i + 2)) for i in range(count))
    return first + more


BOMBS = {
    "webp": (webp, "more than 55 megapixels"),
    "jpeg2000": (jpeg2000, "more than 40 megapixels"),
    "jpeg without its end": (jpeg, DAMAGED),
    "jpeg of exif": (
        lambda: jpeg_with(b"\xff\xe1\xff\xffExif\x00\x00" + bytes(65527), 150),
        "the EXIF data were ignored: they are 10 MB",
    ),
    "png with a palette": (palette_png, "144 megapixels were read at 4000 x 4000 px"),
    "png of texts": (
        lambda: png_with(
            *(chunk(b"zTXt", b"%d\x00\x00" % i + zlib.compress(bytes(1 << 20))) for i in range(70))
        ),
        DAMAGED,
    ),
    "tiff of frames": (many_frames, "only the first of its frames is used"),
    "bmp": (
        lambda: (
            b"BM"
            + struct.pack("<IIIIiiHHIIiiII", 0, 0, 54, 40, SIDE, SIDE, 1, 24, 0, 0, 0, 0, 0, 0)
        ),
        DAMAGED,
    ),
}
"""Name -> how to make the file, and what its error or notes contain."""
