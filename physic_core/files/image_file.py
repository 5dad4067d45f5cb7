"""Open image files of a user: known formats, the first image, memory bounded before decoding, else InputError."""

from __future__ import annotations

import io
import os
import stat
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PIL import Image, ImageFile, PngImagePlugin

from physic_core.errors import InputError, PackageMissingError
from physic_core.files.image_memory import decoding_bytes
from physic_core.files.jpeg_data import check_jpeg_data

if TYPE_CHECKING:
    from io import BufferedReader, BytesIO

MAX_PIXELS = 150_000_000
"""Maximum number of pixels of an image."""

MAX_DECODING_BYTES = 1_300_000_000
"""Most memory that decoding may take, by the header of the file."""

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
"""Suffixes of the files of each format that is read; a file is read by its content, whatever its name."""

_BRANDS = {
    "AVIF": (b"avif", b"avis"),
    "HEIF": (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"hevm", b"hevs", b"mif1", b"msf1"),
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
}


@dataclass(frozen=True)
class ImageSource:
    """An encoded image.

    Attributes:
        name: for error messages, after ``what``.
        content: of the file; None if it is read from ``path``.
        path: of the file; None if ``content`` is given.
        what: the image is, for error messages.
        formats: to give, for error messages.
    """

    name: str
    content: bytes | None = field(default=None, repr=False)
    path: Path | None = None
    what: str = "photo"
    formats: str = "a JPEG, PNG, WebP, AVIF or TIFF"

    def __str__(self) -> str:
        # Line ends and escape sequences in a file name would change the message.
        text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in self.name)
        return f"{self.what} {text}"

    def open(self) -> BufferedReader | BytesIO:
        """Open the file for reading.

        Raises:
            InputError: there is no file, it is not a regular one, is empty or may not be read.
        """
        if self.path is None:
            return io.BytesIO(self.content or b"")
        try:
            self._check(self.path.stat())
            # Without waiting, should a pipe take the place of the file now.
            number = os.open(self.path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        except FileNotFoundError:
            raise InputError(f"cannot read the {self}: there is no such file; check the path") from None
        except PermissionError as error:
            raise InputError(f"cannot read the {self}: {error.strerror}; check who may read it") from error
        except (OSError, ValueError) as error:  # ValueError: characters that a path cannot have
            reason = getattr(error, "strerror", None) or "the path has characters that no path can have"
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
            raise InputError(f"cannot read the {self}: it is not a regular file; name one image file")
        if status.st_size == 0:
            raise InputError(f"cannot read the {self}: the file is empty (0 bytes); copy it again")

    def damaged(self) -> InputError:
        """Return the error for a file whose data are damaged."""
        return InputError(
            f"cannot read the {self}: its data are damaged or truncated; copy it again from where it came, "
            "or save it again from a program that shows it completely"
        )

    def too_large(self) -> InputError:
        """Return the error for an image of more than ``MAX_PIXELS``."""
        return InputError(
            f"cannot use the {self}: it has more than {MAX_PIXELS // 1_000_000} megapixels; give a smaller version"
        )


@contextmanager
def open_image(source: ImageSource) -> Iterator[tuple[Image.Image, BufferedReader | BytesIO]]:
    """Open an image file without decoding it, and check that decoding takes at most ``MAX_DECODING_BYTES``.

    Yields:
        The image, to be decoded by :func:`decode`, and the open file.

    Raises:
        InputError: the file cannot be read, is not an image of a known format, is damaged or too large.
    """
    with source.open() as file:
        kind = _kind(file.read(64))
        if kind is None:
            raise InputError(
                f"cannot read the {source}: it is not an image, or of an unknown kind; give {source.formats}"
            )
        if kind == "HEIF":
            _register_heif(source)
        with wrap_decoding_errors(source):
            file.seek(0)
            image = Image.open(file, formats=["JPEG", "MPO"] if kind == "JPEG" else [kind])
        with image:
            if image.size[0] * image.size[1] > MAX_PIXELS:
                raise source.too_large()
            needed = decoding_bytes(image)
            if needed > MAX_DECODING_BYTES:
                raise InputError(
                    f"cannot use the {source}: decoding its {image.size[0]} x {image.size[1]} px of {kind} takes "
                    f"{needed / 1e9:.1f} GB of memory, more than {MAX_DECODING_BYTES / 1e9:.1f} GB; "
                    "give a smaller version, or a JPEG"
                )
            yield image, file


def decode(image: Image.Image, source: ImageSource) -> None:
    """Decode an image of :func:`open_image`, or any of Pillow, in place.

    Raises:
        InputError: its data are damaged or missing, or memory is not sufficient.
    """
    with wrap_decoding_errors(source):
        # Pillow fills what a JPEG lacks with invented pixels. An image that was decoded before has no tiles.
        if image.format in ("JPEG", "MPO") and getattr(image, "tile", None):
            check_jpeg_data(image.fp)  # type: ignore[attr-defined]
        image.load()


@contextmanager
def wrap_decoding_errors(source: ImageSource) -> Iterator[None]:
    """Convert errors of Pillow and its decoders to InputError; their warnings are not shown.

    Meanwhile, Pillow's global switches have the values that reading relies on, whatever a plugin has set.
    """
    try:
        with warnings.catch_warnings(), _strict_pillow():
            warnings.simplefilter("ignore")
            yield
    except InputError:
        raise
    except Image.DecompressionBombError:
        raise source.too_large() from None
    except MemoryError as error:
        raise InputError(
            f"cannot read the {source}: there is not enough memory to decode it; give a smaller version"
        ) from error
    except Exception as error:  # decoders raise whatever damaged data lead to
        raise source.damaged() from error


_SWITCHES: dict[tuple[Any, str], Any] = {
    (Image, "MAX_IMAGE_PIXELS"): MAX_PIXELS,
    (ImageFile, "LOAD_TRUNCATED_IMAGES"): False,  # True: the checksums of a PNG are not compared
    (PngImagePlugin, "MAX_TEXT_CHUNK"): 1 << 20,
    (PngImagePlugin, "MAX_TEXT_MEMORY"): 64 << 20,
}
_SWITCHING = threading.Lock()
_kept: list[list[Any]] = []  # values of the program, once for each thread that decodes now


@contextmanager
def _strict_pillow() -> Iterator[None]:
    """Set Pillow's global switches; the last thread that leaves sets them as they were before the first."""
    with _SWITCHING:
        _kept.append(_kept[0] if _kept else [getattr(module, name) for module, name in _SWITCHES])
        for (module, name), value in _SWITCHES.items():
            setattr(module, name, value)
    try:
        yield
    finally:
        with _SWITCHING:
            values = _kept.pop()
            if not _kept:
                for (module, name), value in zip(_SWITCHES, values, strict=True):
                    setattr(module, name, value)


def _kind(start: bytes) -> str | None:
    """Return Pillow's name of the format, by the first 64 bytes of a file; None for an unknown format."""
    if start[:4] == b"RIFF" and start[8:12] == b"WEBP":
        return "WEBP"
    if start[4:8] == b"ftyp":
        brands = [start[at : at + 4] for at in range(8, min(len(start), int.from_bytes(start[:4])), 4)]
        return next((kind for kind, known in _BRANDS.items() if any(brand in known for brand in brands)), None)
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
