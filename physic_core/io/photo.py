"""Read a photo as upright 8-bit RGB, with the intrinsics from its EXIF data."""

from __future__ import annotations

import hashlib
import io
import math
import os
import stat
import struct
import warnings
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from physic_core.errors import InputError
from physic_core.io.exif import EXIF_IFD, ORIENTATION, intrinsics_from_exif, swaps_sides
from physic_core.io.result_folder import file_digest, image_digest
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from typing import BinaryIO

    from physic_core.types import Intrinsics, UInt8Array

    PhotoSource = str | os.PathLike[str] | bytes | Image.Image | UInt8Array

__all__ = ["MAX_PIXELS", "MIN_SIDE", "Photo", "check_image", "limit_size", "photo_name", "read_photo", "read_source"]

MIN_SIDE = 64
"""Minimum length of the short side of a photo, px."""

MAX_PIXELS = 150_000_000
"""Maximum number of pixels of a photo; decoding takes up to 12 bytes per pixel."""

_FOCAL_RANGE = (0.1, 100.0)  # of the long side; wider than any lens, narrower than a slip of the unit
_KEEP_PIXELS = 24_000_000  # larger photos are read at a half, a third, ... of their size
_REDUCIBLE = ("L", "RGB", "RGBA", "CMYK")
_PILLOW_DAMAGE = (OSError, SyntaxError, ValueError, EOFError, KeyError, IndexError, TypeError, struct.error)


@dataclass(frozen=True)
class Photo(ShortRepr):
    """Pixels and camera of one photo.

    Attributes:
        image: (H, W, 3) uint8 RGB, upright.
        intrinsics: of ``image``; None if the file has no usable EXIF data.
        notes: conversions of the pixels, as text for the user.
        file_size: (width, height) of the upright file, px, if the image was reduced while reading; None if it was not.
        digest: of the file, if there was one, then of the pixels, separated by a space; "" if it was not computed.
    """

    image: UInt8Array
    intrinsics: Intrinsics | None = None
    notes: tuple[str, ...] = ()
    file_size: tuple[int, int] | None = None
    digest: str = ""


@dataclass(frozen=True)
class _Source:
    """An encoded photo.

    Attributes:
        name: for error messages, after "the photo".
        content: of the file; None if it is read from ``path``.
        path: of the file; None if ``content`` is given.
    """

    name: str
    content: bytes | None = field(default=None, repr=False)
    path: Path | None = None

    def __str__(self) -> str:
        return self.name

    def open(self) -> BinaryIO:
        """Open the file for reading."""
        if self.path is not None:
            return self.path.open("rb")
        return io.BytesIO(self.content or b"")

    def image(self) -> Image.Image:
        """Open the picture without decoding it."""
        return Image.open(io.BytesIO(self.content or b"") if self.path is None else self.path)


def read_photo(photo: str | os.PathLike[str] | bytes) -> Photo:
    """Read a photo file as upright 8-bit RGB, with EXIF intrinsics and a note for each conversion.

    A photo above 24 Mpx is reduced by an integer factor while reading. JPEG is decoded directly at the smaller size.

    Args:
        photo: path of the file, or its content as bytes.

    Raises:
        InputError: the file is missing, is not an image, is damaged, or is too small or too large.
    """
    if isinstance(photo, bytes):
        source = _Source(f"of {len(photo):,} bytes", photo)
    else:
        source = _Source(str(Path(photo)), path=Path(photo))
        _check_file(Path(photo))
    with warnings.catch_warnings():
        # Pillow warns of large pictures and odd EXIF blocks; both are judged here.
        warnings.simplefilter("ignore")
        with _open(source) as image:
            return _read(image, source)


def read_source(photo: PhotoSource) -> Photo:
    """Read a photo from a path, the bytes of a file, a PIL image or an array, and compute its digest.

    Args:
        photo: path or bytes as in :func:`read_photo`; a PIL image of any mode, which is not modified, with the EXIF
            data that it carries; or an upright array (H, W, 3) of uint8 RGB.

    Raises:
        InputError: it is of another type, or cannot be used.
    """
    if isinstance(photo, bytes):
        found, file = read_photo(photo), f"sha256:{hashlib.sha256(photo).hexdigest()}"
    elif isinstance(photo, str | os.PathLike):
        found, file = read_photo(photo), file_digest(photo)
    elif isinstance(photo, Image.Image):
        found, file = _read_image(photo), ""
    else:
        found, file = Photo(check_image(photo)), ""
    return replace(found, digest=" ".join(filter(None, (file, image_digest(found.image)))))


def photo_name(photo: object) -> str:
    """Return the path of a photo for error messages; "" if it has none."""
    if isinstance(photo, Image.Image):
        photo = getattr(photo, "filename", "")
    return str(Path(photo)) if isinstance(photo, str | os.PathLike) and str(photo) else ""


def _read_image(image: Image.Image) -> Photo:
    source = _Source(photo_name(image) or "given as a PIL image")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            copy = image.copy()  # decoding at a smaller size would change the user's image
        except _PILLOW_DAMAGE as error:
            raise _damaged(source) from error
        return _read(copy, source)


def limit_size(photo: Photo, max_side: int) -> Photo:
    """Resize a photo and its intrinsics so that the long side has at most ``max_side`` px.

    Raises:
        InputError: the short side would be below ``MIN_SIDE`` px, or the intrinsics are invalid or have another image
            size.
    """
    height, width = photo.image.shape[:2]
    if photo.intrinsics is not None:
        _check_camera(photo.intrinsics, width, height)
    share = max_side / max(height, width)
    if share >= 1:
        return photo
    new_width, new_height = max(1, round(width * share)), max(1, round(height * share))
    if min(new_width, new_height) < MIN_SIDE:
        raise InputError(
            f"the photo is too long and thin: of its {width} x {height} px, {new_width} x {new_height} px are left at "
            f"a long side of {max_side} px, and each side needs {MIN_SIDE} px; crop it, or allow a longer side"
        )
    import cv2

    image = cast("UInt8Array", cv2.resize(photo.image, (new_width, new_height), interpolation=cv2.INTER_AREA))
    intrinsics = photo.intrinsics.resized(new_width, new_height) if photo.intrinsics else None
    return replace(photo, image=image, intrinsics=intrinsics)


def _check_camera(camera: Intrinsics, width: int, height: int) -> None:
    if (camera.width, camera.height) != (width, height):
        raise InputError(
            f"the intrinsics are of {camera.width} x {camera.height} px, but the image has {width} x {height} px: "
            f"give those of this image, or intrinsics.resized({width}, {height}) where it was only resized"
        )
    side = max(width, height)
    least, most = _FOCAL_RANGE
    for focal in (camera.fx, camera.fy):
        if not least <= focal / side <= most:
            raise InputError(
                f"the focal length is {focal / side:.2g} times the long side of the photo, and a camera's is "
                f"{least:g} to {most:g} times: give it in px of the photo file"
            )
    if not (-0.5 <= camera.cx <= width - 0.5 and -0.5 <= camera.cy <= height - 0.5):
        raise InputError(
            f"the principal point ({camera.cx:g}, {camera.cy:g}) lies outside the photo of {width} x {height} px: "
            "give it in px of the photo file, or give the focal length alone"
        )


def check_image(image: Any) -> UInt8Array:
    """Validate an image (H, W, 3) uint8 RGB and return it as a contiguous array.

    Raises:
        InputError: wrong type, dtype, shape or size.
    """
    if not isinstance(image, np.ndarray):
        raise InputError(
            f"image must be a numpy array (H, W, 3) of uint8 RGB, got {type(image).__name__}: "
            "give a path, the bytes of a file, a PIL image, or convert it"
        )
    if image.ndim != 3 or image.shape[2] != 3:
        raise InputError(f"image must be (H, W, 3), got {image.shape}: {_shape_advice(image.shape)}")
    if image.dtype != np.uint8:
        advice = "scale it to 0-255 and convert it" if image.dtype.kind == "f" else "convert it"
        raise InputError(f"image must be uint8 with values 0-255, got {image.dtype}: {advice}")
    if min(image.shape[:2]) < MIN_SIDE:
        raise InputError(
            f"image is {image.shape[1]} x {image.shape[0]} px, and each side must have at least {MIN_SIDE} px: "
            "give a larger one"
        )
    return np.ascontiguousarray(image)


def _shape_advice(shape: tuple[int, ...]) -> str:
    if len(shape) == 2:
        return "repeat the grey channel three times"
    if len(shape) == 4 and shape[0] == 1:
        return "drop the batch axis"
    if len(shape) == 4:
        return "give one image at a time"
    if len(shape) == 3 and shape[2] == 4:
        return "drop the alpha channel"
    if len(shape) == 3 and shape[2] == 1:
        return "repeat the grey channel three times"
    if len(shape) == 3 and shape[0] == 3:
        return "put the channels last"
    return "give one RGB image"


def _check_file(path: Path) -> None:
    try:
        status = path.stat()
    except FileNotFoundError:
        raise InputError(f"cannot read the photo {path}: there is no such file; check the path") from None
    except OSError as error:
        raise InputError(f"cannot read the photo {path}: {error.strerror}; check the path") from error
    if stat.S_ISDIR(status.st_mode):
        raise InputError(f"cannot read the photo {path}: it is a folder; name one image file")
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"cannot read the photo {path}: it is not a regular file; name one image file")
    if status.st_size == 0:
        raise InputError(f"cannot read the photo {path}: the file is empty (0 bytes); copy it again")


def _open(source: _Source) -> Image.Image:
    try:
        return source.image()
    except UnidentifiedImageError:
        pass
    except Image.DecompressionBombError:
        raise _too_large(source) from None
    except PermissionError as error:
        raise InputError(f"cannot read the photo {source}: {error.strerror}; check who may read it") from error
    except _PILLOW_DAMAGE as error:
        raise _damaged(source) from error
    if _is_heif(source):
        return _open_heif(source)
    raise InputError(
        f"cannot read the photo {source}: it is not an image, or of an unknown kind; "
        "give a JPEG, PNG, WebP, AVIF or TIFF"
    )


def _is_heif(source: _Source) -> bool:
    with source.open() as file:
        head = file.read(12)
    return head[4:8] == b"ftyp" and head[8:12] in (b"heic", b"heix", b"hevc", b"heim", b"heis", b"mif1", b"msf1")


def _open_heif(source: _Source) -> Image.Image:
    """Open HEIC, the format of many phones, with the optional package ``pillow-heif``."""
    try:
        from pillow_heif import register_heif_opener  # type: ignore[import-not-found, unused-ignore]
    except ImportError:
        raise InputError(
            f"cannot read the photo {source}: it is HEIC, which needs one more package; "
            "run `pip install pillow-heif`, or convert the photo to JPEG"
        ) from None
    register_heif_opener()
    try:
        return source.image()
    except Image.DecompressionBombError:
        raise _too_large(source) from None
    except _PILLOW_DAMAGE as error:
        raise _damaged(source) from error


def _read(image: Image.Image, source: _Source) -> Photo:
    stored = image.size
    if stored[0] * stored[1] > MAX_PIXELS:
        raise _too_large(source)
    if min(stored) < MIN_SIDE:
        raise InputError(
            f"cannot use the photo {source}: it is {stored[0]} x {stored[1]} px, and each side must have at least "
            f"{MIN_SIDE} px; give a larger photo"
        )
    notes = list(_frame_notes(image))
    deep = _is_deep(image)  # before decoding, which discards the mode of the file
    factor = math.ceil(math.sqrt(stored[0] * stored[1] / _KEEP_PIXELS))
    try:
        if factor > 1:
            image.draft(image.mode, (stored[0] // factor, stored[1] // factor))
        image.load()
    except _PILLOW_DAMAGE as error:
        complete = _decode_without_end_marker(source, image.mode, image.size) if image.format == "JPEG" else None
        if complete is None:
            raise _damaged(source) from error
        image = complete
        notes.append("the file's last bytes are missing; its picture is complete")
    orientation, tags = _exif(image)
    left = factor // max(1, round(max(stored) / max(image.size)))  # what the decoder has not reduced itself
    pixels = ImageOps.exif_transpose(image) if orientation != 1 else image
    if left > 1 and pixels.mode in _REDUCIBLE:
        pixels, left = pixels.reduce(left), 1  # before the conversions, each of which takes a copy
    rgb, conversions = _to_rgb(pixels, deep, source)
    if orientation != 1:
        notes.append("rotated upright by the EXIF orientation")
    notes += conversions
    if left > 1:
        rgb = rgb.reduce(left)
    if factor > 1:
        notes.append(f"{stored[0] * stored[1] / 1e6:.0f} megapixels were read at {rgb.size[0]} x {rgb.size[1]} px")
    intrinsics, note = intrinsics_from_exif(tags, stored, rgb.size[0], rgb.size[1], orientation)
    if note:
        notes.append(note)
    upright = stored[::-1] if swaps_sides(orientation) else stored
    return Photo(np.array(rgb), intrinsics, tuple(notes), upright if factor > 1 else None)


def _decode_without_end_marker(source: _Source, mode: str, size: tuple[int, int]) -> Image.Image | None:
    """Decode a JPEG without end marker; None if pixels are missing too.

    libjpeg invents missing pixels. So the data are completed in three ways: with the end marker, with other bytes
    before it, and with restart markers. If all pixels are present, the three results are equal.
    """
    with source.open() as file:
        data = file.read().rstrip(b"\xff")  # in the picture itself 0 follows each of these
    more = bytes(range(1, 255))
    marks = b"".join(b"\xff" + bytes([0xD0 + i % 8]) + more for i in range(16))
    decoded: list[Image.Image] = []
    for tail in (b"", more, marks):
        try:
            image = Image.open(io.BytesIO(data + tail + b"\xff\xd9"))
            image.draft(mode, size)
            image.load()
        except _PILLOW_DAMAGE:
            return None
        decoded.append(image)
    first, *others = decoded
    return first if all(np.array_equal(np.asarray(first), np.asarray(other)) for other in others) else None


def _frame_notes(image: Image.Image) -> tuple[str, ...]:
    frames = getattr(image, "n_frames", 1)
    # The MPO file of a phone has a preview or a depth image after the photo, which is not needed.
    return (f"only the first of {frames} frames is used",) if frames > 1 and image.format != "MPO" else ()


def _is_deep(image: Image.Image) -> bool:
    """Whether the file has 16 bits per channel; Pillow keeps these only for grey images."""
    if image.mode.startswith("I"):
        return True
    tiles = getattr(image, "tile", None) or ()
    return any(";16" in str(tile[3]) for tile in tiles)


def _exif(image: Image.Image) -> tuple[int, dict[int, Any]]:
    try:
        exif = image.getexif()
        orientation = exif.get(ORIENTATION, 1)
        tags = dict(exif.get_ifd(EXIF_IFD))
    except _PILLOW_DAMAGE:
        return 1, {}  # the pixels are valid: a damaged EXIF block only loses the focal length
    return (orientation if orientation in range(2, 9) else 1), tags


def _to_rgb(image: Image.Image, deep: bool, source: _Source) -> tuple[Image.Image, list[str]]:
    """Convert any Pillow mode to RGB, with a note for each conversion."""
    notes = ["16 bits a channel were scaled to 8"] if deep else []
    if image.mode.startswith("I"):
        image = _grey_from_deep(image, source)
    elif image.mode == "F":
        raise InputError(f"cannot use the photo {source}: its pixels are floating point; save it with 8 bits a channel")
    if image.has_transparency_data or image.mode in ("La", "RGBa"):
        layers = image.convert("RGBA")
        if np.asarray(layers)[..., 3].min() < 255:
            notes.append("transparent parts were laid over mid-grey")
            layers = Image.alpha_composite(Image.new("RGBA", layers.size, (128, 128, 128, 255)), layers)
        grey = image.mode in ("LA", "La", "L")
        image = layers.convert("RGB")
    else:
        grey = image.mode in ("1", "L")
        if image.mode == "CMYK":
            notes.append("CMYK colours were converted to RGB without a colour profile")
        if image.mode != "RGB":
            image = image.convert("RGB")
    if grey:
        notes.append("the photo is grey: its one channel stands for red, green and blue")
    return image, notes


def _grey_from_deep(image: Image.Image, source: _Source) -> Image.Image:
    values = np.asarray(image)
    if values.size and (values.min() < 0 or values.max() > 65535):
        raise InputError(f"cannot use the photo {source}: its pixels have 32 bits; save it with 8 bits a channel")
    return Image.fromarray(((values.astype(np.uint32) + 128) // 257).astype(np.uint8))


def _damaged(source: _Source) -> InputError:
    return InputError(
        f"cannot read the photo {source}: its data are damaged or cut off; copy it again from where it came"
    )


def _too_large(source: _Source) -> InputError:
    return InputError(
        f"cannot use the photo {source}: it has more than {MAX_PIXELS // 1_000_000} megapixels; give a smaller version"
    )
