"""Open image files of a user: known formats, the first image, pixels bounded before decoding, else
InputError.

Decoders invent pixels for data that are missing inside a JPEG file, and Pillow drops their
warnings. So such gaps are searched for first.
"""

from __future__ import annotations

import io
import os
import re
import stat
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import simplejpeg
from PIL import Image, ImageFile, PngImagePlugin, UnidentifiedImageError

from physic_core.errors import InputError, PackageMissingError
from physic_core.files.text import printable

if TYPE_CHECKING:
    from io import BufferedReader, BytesIO

MAX_PIXELS = 150_000_000
"""Maximum number of pixels of an image."""

_MAX_PIXELS_OF = {
    "HEIF": 100_000_000,
    "TIFF": 100_000_000,
    "WEBP": 55_000_000,
    "AVIF": 55_000_000,
    "JPEG2000": 40_000_000,
}
"""The same for formats with decoders that take 12 to 32 bytes per pixel, in place of up to 9: 1.4
GB at most.
"""

MAX_SCANS = 500
"""Maximum number of scans of a JPEG.

Cameras and editors write up to about 20; each takes the time of a complete picture.
"""

_MAX_JPEG_BYTES = 400_000_000
_MAX_PADDING = 64
"""Encoders in cameras fill the end of the picture data up to a multiple of some bytes."""

_LOST_BLOCK = 256
"""Zeros that no picture has, bytes; a lost block of a disk or a download has 512 or more."""

# The first bytes of a segment: 0xff in a picture and restarts do not match.
_MARKER = re.compile(rb"\xff([^\x00\xff\xd0-\xd7])")
_SOI = 0xD8
_EOI = 0xD9
_SOS = 0xDA
_TEM = 0x01
_DHT = 0xC4
_SEQUENTIAL = (0xC0, 0xC1)  # frames without refinement, in which zeros can be bits of many pixels
_EXTRA = re.compile(r"Corrupt JPEG data: (\d+) extraneous bytes before marker 0xd9")

IMAGE_SUFFIXES = {
    "JPEG": (".jpg", ".jpeg", ".jpe", ".jfif"),
    "MPO": (".mpo",),
    "PNG": (".png", ".apng"),
    "WEBP": (".webp",),
    "AVIF": (".avif", ".avifs"),
    "HEIF": (".heic", ".heics", ".heif", ".heifs", ".hif"),
    "TIFF": (".tif", ".tiff"),
    "GIF": (".gif",),
    "BMP": (".bmp",),
    "JPEG2000": (".jp2", ".j2k", ".j2c", ".jpc", ".jpf", ".jpx"),
    "PPM": (".ppm", ".pgm", ".pbm", ".pnm"),
}
"""Suffixes of the files of each format that is read; a file is read by its content, not by its
name.
"""

_BRANDS = {
    "AVIF": (b"avif", b"avis"),
    "HEIF": (
        b"heic",
        b"heix",
        b"heim",
        b"heis",
        b"hevc",
        b"hevx",
        b"hevm",
        b"hevs",
        b"mif1",
        b"msf1",
    ),
}
_STARTS = {
    b"\xff\xd8\xff": "JPEG",
    b"\x89PNG\r\n\x1a\n": "PNG",
    b"II*\x00": "TIFF",
    b"MM\x00*": "TIFF",
    b"II+\x00": "TIFF",
    b"MM\x00+": "TIFF",
    b"GIF87a": "GIF",
    b"GIF89a": "GIF",
    b"BM": "BMP",
    b"\x00\x00\x00\x0cjP  \r\n\x87\n": "JPEG2000",
    b"\xff\x4f\xff\x51": "JPEG2000",
    **{b"P%d" % i: "PPM" for i in range(1, 7)},
    b"Pf": "PPM",  # PFM of one channel, floating point
}
_NOT_READ = {
    b"\xff\x0a": "JPEG XL",
    b"\x00\x00\x00\x0cJXL ": "JPEG XL",
    b"#?RADIANCE": "a Radiance picture (.hdr)",
    b"#?RGBE": "a Radiance picture (.hdr)",
    b"v/1\x01": "OpenEXR",
    b"8BPS": "a Photoshop document",
    b"%PDF": "PDF",
    b"PK\x03\x04": "a ZIP archive, as LIVP of phones and many others are",
    b"\x1f\x8b": "a gzip archive",
    b"\x1aE\xdf\xa3": "a video (Matroska or WebM)",
    b"<svg": "SVG",
    b"<!DOCTYPE": "a page of the web, perhaps the message of a download that failed",
    b"<html": "a page of the web, perhaps the message of a download that failed",
}
"""First bytes -> kind of files that people take for photos."""

_VIDEO_BRANDS = (
    *(b"isom", b"iso2", b"iso4", b"iso5", b"iso6"),
    *(b"mp41", b"mp42", b"qt  ", b"M4V ", b"avc1"),
)
_TAR = 257  # bytes before the mark of a tar archive

_RAW_STARTS = (
    b"FUJIFILMCCD-RAW",
    *(b"IIRO", b"IIRS", b"MMOR"),  # Olympus
    *(b"IIU\x00", b"\x00MRM", b"FOVb"),  # Panasonic, Minolta, Sigma
)
_RAW_PARTS = {4: b"ftypcrx ", 6: b"HEAPCCDR", 8: b"CR\x02"}  # Canon
_RAW_SUFFIXES = (
    *(
        ".3fr",
        ".arw",
        ".cr2",
        ".cr3",
        ".crw",
        ".dcr",
        ".dng",
        ".erf",
        ".iiq",
        ".kdc",
        ".mef",
        ".mos",
        ".mrw",
        ".nef",
    ),
    *(".nrw", ".orf", ".pef", ".raf", ".raw", ".rw2", ".rwl", ".sr2", ".srf", ".srw", ".x3f"),
)


@dataclass(frozen=True)
class ImageSource:
    """An encoded image.

    Attributes:
        name: for error messages, after ``role``.
        content: of the file; None if it is read from ``path``.
        path: of the file; None if ``content`` is given.
        role: the image is, for error messages.
        formats: to give, for error messages.
    """

    name: str
    content: bytes | None = field(default=None, repr=False)
    path: Path | None = None
    role: str = "photo"
    formats: str = "a JPEG, PNG, WebP, AVIF or TIFF"

    def __str__(self) -> str:
        # Line ends and escape sequences in a file name would change the message.
        return f"{self.role} {printable(self.name, kept='')}"

    @property
    def suffix(self) -> str:
        """Suffix of the path in small letters; "" without a path."""
        return "" if self.path is None else self.path.suffix.lower()

    def open(self) -> BufferedReader | BytesIO:
        """Open the file for reading.

        Raises:
            InputError: there is no file, it is not a regular one, is empty or may not be read.
        """
        if self.path is None:
            return io.BytesIO(self.content or b"")
        try:
            self._check(self.path.stat())
            # O_NONBLOCK: does not wait if a pipe has replaced the file since.
            number = os.open(
                self.path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
            )
        except FileNotFoundError:
            raise InputError(
                f"cannot read the {self}: there is no such file; check the path"
            ) from None
        except PermissionError as error:
            raise InputError(
                f"cannot read the {self}: {error.strerror}; check who may read it"
            ) from error
        except (OSError, ValueError) as error:  # ValueError: characters that a path cannot have
            reason = (
                getattr(error, "strerror", None) or "the path has characters that no path can have"
            )
            raise InputError(f"cannot read the {self}: {reason}; check the path") from error
        file = os.fdopen(number, "rb")
        try:
            self._check(os.fstat(number))
        except InputError:
            file.close()
            raise
        return file

    def _check(self, status: os.stat_result) -> None:
        if stat.S_ISDIR(status.st_mode):
            raise InputError(f"cannot read the {self}: it is a folder; name one image file")
        if not stat.S_ISREG(status.st_mode):
            raise InputError(
                f"cannot read the {self}: it is not a regular file; name one image file"
            )
        if status.st_size == 0:
            raise InputError(f"cannot read the {self}: the file is empty (0 bytes); copy it again")

    def damaged_error(self) -> InputError:
        """Return the error for a file whose data are damaged."""
        return InputError(
            f"cannot read the {self}: its data are damaged or truncated; copy it again from its "
            "source, or save it again in a program that shows all of it"
        )

    def raw_error(self) -> InputError:
        """Return the error for a raw file of a camera."""
        return InputError(
            f"cannot use the {self}: it is a raw file of a camera: develop it first, and give the "
            f"JPEG, TIFF or PNG"
        )

    def too_large_error(self, limit: int = MAX_PIXELS) -> InputError:
        """Return the error for an image of more pixels than a limit."""
        return InputError(
            f"cannot use the {self}: it has more than {limit // 1_000_000} megapixels; give a "
            f"smaller JPEG"
        )


def max_pixels(kind: str) -> int:
    """Return the maximum number of pixels of an image of one of :data:`IMAGE_SUFFIXES`."""
    return _MAX_PIXELS_OF.get(kind, MAX_PIXELS)


@contextmanager
def open_image(source: ImageSource) -> Iterator[tuple[Image.Image, BufferedReader | BytesIO]]:
    """Open an image file without decoding it, and check the number of its pixels.

    Yields:
        The image, to be decoded by :func:`decode`, and the open file.

    Raises:
        InputError: the file cannot be read, is not an image of a known format, is damaged or too
            large.
    """
    with source.open() as file:
        start = file.read(_TAR + 5)
        kind = _image_format(start)
        if _is_raw(start) or (kind in (None, "TIFF") and source.suffix in _RAW_SUFFIXES):
            raise source.raw_error()
        if kind is None:
            role = _unsupported_format(start)
            raise InputError(
                f"cannot read the {source}: it is not an image of a kind that is read, but {role}: "
                f"unpack it, or save a picture of it as {source.formats}"
                if role
                else f"cannot read the {source}: it is not an image, or of an unknown kind; give "
                f"{source.formats}"
            )
        if kind == "HEIF":
            _register_heif(source)
        with wrap_decoding_errors(source):
            file.seek(0)
            try:
                image = Image.open(file, formats=["JPEG", "MPO"] if kind == "JPEG" else [kind])
            except UnidentifiedImageError as error:
                if kind != "TIFF":
                    raise
                raise InputError(
                    f"cannot read the {source}: its header is damaged, or its pixels are of an "
                    "unusual kind, such as floating point in several channels; save it with 8 bits "
                    "per channel"
                ) from error
        with image:
            if image.size[0] * image.size[1] > max_pixels(kind):
                raise source.too_large_error(max_pixels(kind))
            yield image, file


def decode(image: Image.Image, source: ImageSource) -> bool:
    """Decode an image of :func:`open_image`, or any of Pillow, in place.

    Returns:
        Whether it is a JPEG that lacked its end marker, and nothing else.

    Raises:
        InputError: its data are damaged or missing, or memory is not sufficient.
    """
    whole = None
    with wrap_decoding_errors(source):
        # Pillow fills what a JPEG lacks with invented pixels. An image that was decoded before has
        # no tiles.
        if image.format in ("JPEG", "MPO") and getattr(image, "tile", None):
            whole = _check_jpeg_data(image.fp)  # type: ignore[attr-defined]
            if whole is not None:
                image.fp = io.BytesIO(whole)  # type: ignore[attr-defined]
        image.load()
    return whole is not None


_SWITCHES: dict[tuple[Any, str], Any] = {
    (Image, "MAX_IMAGE_PIXELS"): MAX_PIXELS,
    (ImageFile, "LOAD_TRUNCATED_IMAGES"): False,  # True: the checksums of a PNG are not compared
    (PngImagePlugin, "MAX_TEXT_CHUNK"): 1 << 20,
    (PngImagePlugin, "MAX_TEXT_MEMORY"): 64 << 20,
}
_DECODING = threading.RLock()


@contextmanager
def wrap_decoding_errors(source: ImageSource) -> Iterator[None]:
    """Convert errors of Pillow and its decoders to InputError; their warnings are not shown.

    Inside the block, Pillow's global switches have the values that reading relies on, even if a
    plugin has set others. Other threads wait.
    """
    with _DECODING, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        before = [getattr(module, name) for module, name in _SWITCHES]
        try:
            for (module, name), value in _SWITCHES.items():
                setattr(module, name, value)
            yield
        except InputError:
            raise
        except Image.DecompressionBombError:
            raise source.too_large_error() from None
        except MemoryError as error:
            raise InputError(
                f"cannot read the {source}: there is not enough memory to decode it; give a "
                f"smaller version"
            ) from error
        except Exception as error:  # decoders raise many classes for damaged data
            raise source.damaged_error() from error
        finally:
            for (module, name), value in zip(_SWITCHES, before, strict=True):
                setattr(module, name, value)


def _is_raw(start: bytes) -> bool:
    """Return whether a file is the raw file of a camera, by its first bytes; other raw files are
    TIFF.
    """
    return start.startswith(_RAW_STARTS) or any(
        start[at:].startswith(part) for at, part in _RAW_PARTS.items()
    )


def _unsupported_format(start: bytes) -> str:
    """Return the kind of a file that is not read, by its first bytes; "" for an unknown one."""
    if start[4:8] == b"ftyp" and start[8:12] in _VIDEO_BRANDS:
        return "a video"
    if start[_TAR : _TAR + 5] == b"ustar":
        return "a tar archive"
    return next((kind for first, kind in _NOT_READ.items() if start.startswith(first)), "")


def _image_format(start: bytes) -> str | None:
    """Return Pillow's name of the format, by the first bytes of a file; None if not known."""
    if start[:4] == b"RIFF" and start[8:12] == b"WEBP":
        return "WEBP"
    if start[4:8] == b"ftyp":
        brands = [
            start[at : at + 4] for at in range(8, min(len(start), int.from_bytes(start[:4])), 4)
        ]
        return next(
            (kind for kind, known in _BRANDS.items() if any(brand in known for brand in brands)),
            None,
        )
    return next((kind for first, kind in _STARTS.items() if start.startswith(first)), None)


def _register_heif(source: ImageSource) -> None:
    """Let Pillow read HEIC, the format of many phones, with the optional package ``pi-heif``."""
    try:
        from pi_heif import register_heif_opener  # type: ignore[import-not-found, import-untyped, unused-ignore]
    except ImportError:
        raise PackageMissingError(
            f"cannot read the {source}: it is HEIC, which needs one more package; "
            "run `pip install pi-heif`, or convert the photo to JPEG"
        ) from None
    register_heif_opener()


def _check_jpeg_data(file: BinaryIO) -> bytes | None:
    """Raise ValueError if data of the picture are missing or damaged, by decoding it at an eighth
    of its size.

    libjpeg-turbo, which Pillow uses too, warns where the codes of the picture and its size
    disagree. Damage that leaves as many codes as before, such as a changed bit, gives no warning.
    So lost blocks of zeros are looked for, too.

    Args:
        file: the content of a JPEG file.

    Returns:
        The content with its end marker, if that alone is missing; else None.

    Raises:
        ValueError: data are missing, there are more than ``MAX_SCANS`` scans or 400 MB, or the
            sampling of the colours is of a kind that libjpeg-turbo cannot name.
    """
    size = file.seek(0, 2)
    if size > _MAX_JPEG_BYTES:
        raise ValueError(f"a JPEG of {size} bytes")
    data = bytearray(size)
    whole = None
    file.seek(0)
    file.readinto(data)  # type: ignore[attr-defined]
    tables = bytearray((0xFF, _SOI))
    scans = []
    end = 0
    huffman = b""
    sequential = False
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
    if not end:
        data = data.rstrip(b"\xff")  # in the picture itself 0 follows each of these
        end = len(data)
        data += bytes((0xFF, _EOI))
        whole = bytes(data)
    one_scan = sequential and len(scans) == 1
    if (
        one_scan
        and not _zeros_can_be_plain(huffman)
        and data.find(bytes(_LOST_BLOCK), scans[0], end) >= 0
    ):
        raise ValueError(f"{_LOST_BLOCK} bytes of zeros in the picture")
    # The tables alone, right before the picture: harmless oddities of other segments would be the
    # only warning.
    begin = scans[0] - len(tables)
    data[begin : scans[0]] = tables
    try:
        simplejpeg.decode_jpeg(
            memoryview(data)[begin:], "GRAY", min_height=1, min_width=1, min_factor=8
        )
    except ValueError as error:
        extra = _EXTRA.fullmatch(str(error))
        count = int(extra[1]) if extra else size
        if count > _MAX_PADDING or data[end - count : end].strip(b"\x00\xff"):
            raise
    return whole


def _zeros_can_be_plain(huffman: bytes) -> bool:
    """Return whether zeros end each block, as in optimised tables of pictures with large plain
    areas.
    """
    place = 0
    # class and number of a table, 16 counts of codes, and a symbol for each code
    while place < len(huffman):
        if huffman[place] >= 0x10 and huffman[place + 17 : place + 18] != b"\x00":
            return False
        place += 17 + sum(huffman[place + 1 : place + 17])
    return True


def _segments(data: bytearray) -> Iterator[tuple[int, int, int]]:
    """Yield marker, start and end of each segment, up to the end of the picture; a scan's ends
    before its codes.
    """
    place = 2
    while match := _MARKER.search(data, place):
        marker = match[1][0]
        place = match.end()
        if marker not in (_SOI, _EOI, _TEM):  # these have no length
            place += max(2, int.from_bytes(data[place : place + 2]))
        yield marker, match.start(), place
        if marker == _EOI:
            return
