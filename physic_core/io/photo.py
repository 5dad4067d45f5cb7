"""Read a photo as upright 8-bit RGB, with the intrinsics from its EXIF data."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from PIL import Image

from physic_core.errors import ConfigError, InputError
from physic_core.files.image_file import (
    MAX_PIXELS,
    ImageSource,
    decode,
    open_image,
    wrap_decoding_errors,
)
from physic_core.io.color_profile import code_points, srgb_conversion
from physic_core.io.exif import (
    EXIF_IFD,
    INTEROPERABILITY_IFD,
    ORIENTATION,
    intrinsics_from_exif,
    swaps_sides,
)
from physic_core.io.file_geometry import (
    drone_note,
    panorama_kind,
    stretched_pixel_note,
    up_of_gimbal,
)
from physic_core.io.result_folder import file_digest, image_digest
from physic_core.io.thumbnail import share_of_thumbnail, was_encoded_anew
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Intrinsics, UInt8Array

    PhotoSource = str | os.PathLike[str] | bytes | Image.Image | UInt8Array

MIN_SIDE = 64
"""Minimum length of the short side of a photo, px."""

# In long sides: wider than any lens, narrower than a slip of the unit.
_FOCAL_RANGE = (0.1, 100.0)
_LARGEST_ASPECT = 1.5  # of pixels: more than that of any video
_KEEP_PIXELS = 24_000_000  # larger photos are read at a half, a third, ... of their size
_ARRAY = ImageSource("given as an array")
_BAND_PIXELS = 4_000_000  # are converted at once: each conversion takes a copy
_MAX_EXIF_BYTES = 1 << 20  # Pillow takes up to 50 times as much
_UPRIGHT = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}
"""EXIF orientation -> how to turn the stored image upright."""


@dataclass(frozen=True)
class Photo(ShortRepr):
    """Pixels and camera of one photo.

    Attributes:
        image: (H, W, 3) uint8 RGB, upright.
        intrinsics: of ``image``; None if the file has no usable EXIF data.
        notes: conversions of the pixels, as text for the user.
        file_size: (width, height) of the upright file, px, if the image was downscaled while
            reading, otherwise None.
        digest: of the file, or of the pixels of a photo without a file; "" if it was not computed.
        name: of the file; "" for a photo without one.
        warnings: why the picture itself may mislead, as text for the user.
        up: (3,) unit vector against gravity in the camera frame that the file states, or None.
    """

    image: UInt8Array
    intrinsics: Intrinsics | None = None
    notes: tuple[str, ...] = ()
    file_size: tuple[int, int] | None = None
    digest: str = ""
    name: str = ""
    warnings: tuple[str, ...] = ()
    up: FloatArray | None = None


def read_photo(photo: PhotoSource) -> Photo:
    """Read a photo as upright 8-bit RGB, with its digest, EXIF intrinsics and a note for each
    conversion.

    A photo above 24 Mpx is downscaled by an integer factor while reading. JPEG is decoded directly
    at the smaller size.

    Args:
        photo: path of a file, or its content as bytes; a PIL image of any mode, which is not
            modified, with its EXIF data; or an upright uint8 array: (H, W, 3) RGB, or grey (H, W)
            or (H, W, 1) and RGBA (H, W, 4), which are converted like PIL images of these modes.

    Raises:
        InputError: it is missing, is not an image, is damaged, of another type, or too small or too
            large.
    """
    if isinstance(photo, bytes | str | os.PathLike):
        source = (
            ImageSource(f"of {len(photo):,} bytes", photo)
            if isinstance(photo, bytes)
            else ImageSource(str(Path(photo)), path=Path(photo))
        )
        with open_image(source) as (image, file):
            position = file.tell()
            file.seek(0)
            # of the file that is read, even if another one takes its place
            digest = file_digest(file)
            file.seek(0)
            colours = code_points(file)
            file.seek(position)
            return replace(_read_pixels(image, source, colours), digest=digest)
    if isinstance(photo, Image.Image):
        photo_read = _read_image(photo)
    elif (
        isinstance(photo, np.ndarray)
        and photo.dtype == np.uint8
        and photo.ndim > 1
        and photo.shape[2:] in ((), (1,), (4,))
    ):
        array = np.ascontiguousarray(photo)
        photo_read = _read_pixels(
            Image.fromarray(array[..., 0] if array.shape[2:] == (1,) else array), _ARRAY
        )
    else:
        photo_read = Photo(check_image(photo))
    return replace(photo_read, digest=image_digest(photo_read.image))


def photo_path_for_messages(photo: object) -> str:
    """Return the path of a photo for error messages; "" if it has none."""
    if isinstance(photo, Image.Image):
        photo = getattr(photo, "filename", "")
    return str(Path(photo)) if isinstance(photo, str | os.PathLike) and str(photo) else ""


def _read_image(image: Image.Image) -> Photo:
    source = ImageSource(photo_path_for_messages(image) or "given as a PIL image")
    if image.size[0] * image.size[1] > MAX_PIXELS:
        raise source.too_large_error()
    decode(image, source)
    with wrap_decoding_errors(source):
        copy = image.copy()  # decoding at a smaller size would change the user's image
    return _read_pixels(copy, source)


def limit_size(photo: Photo, max_side: int) -> Photo:
    """Resize a photo and its intrinsics so that the long side has at most ``max_side`` px.

    Raises:
        InputError: the short side would be below ``MIN_SIDE`` px.
        ConfigError: the intrinsics are invalid, or have another image size.
    """
    height, width = photo.image.shape[:2]
    if photo.intrinsics is not None:
        _check_camera(photo.intrinsics, width, height)
    share = max_side / max(height, width)
    if share >= 1:
        return photo
    new_width = max(1, round(width * share))
    new_height = max(1, round(height * share))
    if min(new_width, new_height) < MIN_SIDE:
        raise InputError(
            f"the photo is too long and thin: at a long side of {max_side} px, its {width} x "
            f"{height} px become {new_width} x {new_height} px, but each side needs {MIN_SIDE} px; "
            "crop it, or allow a longer side"
        )
    import cv2

    image = cast(
        "UInt8Array", cv2.resize(photo.image, (new_width, new_height), interpolation=cv2.INTER_AREA)
    )
    intrinsics = photo.intrinsics.resized(new_width, new_height) if photo.intrinsics else None
    return replace(photo, image=image, intrinsics=intrinsics)


def _check_camera(camera: Intrinsics, width: int, height: int) -> None:
    if (camera.width, camera.height) != (width, height):
        raise ConfigError(
            f"the intrinsics are for {camera.width} x {camera.height} px, but the image has "
            f"{width} x {height} px: give those of this image, or intrinsics.resized({width}, "
            f"{height}) if it was only resized"
        )
    side = max(width, height)
    smallest, largest = _FOCAL_RANGE
    for focal in (camera.fx, camera.fy):
        if not smallest <= focal / side <= largest:
            raise ConfigError(
                f"the focal length is {focal / side:.2g} times the long side of the photo, but "
                f"should be {smallest:g} to {largest:g} times: give it in px of the photo file"
            )
    if max(camera.fx / camera.fy, camera.fy / camera.fx) > _LARGEST_ASPECT:
        raise ConfigError(
            f"the focal lengths are {camera.fx:g} and {camera.fy:g} px, but pixels are almost "
            f"square: give those of this photo, and stretch one of an anamorphic lens first"
        )
    if not (-0.5 <= camera.cx <= width - 0.5 and -0.5 <= camera.cy <= height - 0.5):
        raise ConfigError(
            f"the principal point ({camera.cx:g}, {camera.cy:g}) lies outside the photo of {width} "
            f"x {height} px: give it in px of the photo file, or give only the focal length"
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
    if image.dtype != np.uint8:
        advice = "scale it to 0-255 and convert it" if image.dtype.kind == "f" else "convert it"
        raise InputError(f"image must be uint8 with values 0-255, got {image.dtype}: {advice}")
    if image.ndim != 3 or image.shape[2] != 3:
        raise InputError(
            f"image must be (H, W, 3), got {image.shape}: give one RGB image, channels last"
        )
    if min(image.shape[:2]) < MIN_SIDE:
        raise InputError(
            f"image is {image.shape[1]} x {image.shape[0]} px, but each side needs at least "
            f"{MIN_SIDE} px: give a larger one"
        )
    return np.ascontiguousarray(image)


_NEW_SUBFILE_TYPE = 254  # tag of TIFF
_DNG_VERSION = 50706  # tag of DNG


def _is_raw_tiff(image: Image.Image) -> bool:
    """Return whether a TIFF is a raw file (DNG, NEF and others), whose first image is a reduced
    copy of another.
    """
    if image.format != "TIFF":
        return False
    tags = getattr(image, "tag_v2", {})
    return bool(int(tags.get(_NEW_SUBFILE_TYPE, 0)) & 1) or _DNG_VERSION in tags


def check_photo_file(path: Path) -> None:
    """Raise InputError if the start of a file shows that :func:`read_photo` will refuse it; its
    pixels are not decoded.
    """
    source = ImageSource(str(path), path=path)
    with open_image(source) as (image, _):
        _check_header(image, source)


def _check_header(image: Image.Image, source: ImageSource) -> None:
    stored = image.size
    if min(stored) < MIN_SIDE:
        raise InputError(
            f"cannot use the {source}: it is {stored[0]} x {stored[1]} px, but each side needs at "
            f"least {MIN_SIDE} px; give a larger photo"
        )
    if image.mode == "F":
        raise InputError(
            f"cannot use the {source}: its pixels are floating point; save it with 8 bits per "
            f"channel"
        )
    if _is_raw_tiff(image):
        raise source.raw_error()


def _read_pixels(
    image: Image.Image, source: ImageSource, colours: tuple[int, int] | None = None
) -> Photo:
    _check_header(image, source)
    stored = image.size
    notes = list(_frame_notes(image))
    xmp = _read_xmp(image)
    deep = _has_16_bits(image)  # before decoding, which discards the mode of the file
    factor = math.ceil(math.sqrt(stored[0] * stored[1] / _KEEP_PIXELS))
    if factor > 1:
        image.draft(image.mode, (stored[0] // factor, stored[1] // factor))
    if decode(image, source):
        notes.append("the file's last bytes are missing; the image is complete")
    orientation, tags, exif_note = _exif(image)
    if panorama := panorama_kind(xmp, tags):
        raise InputError(
            f"cannot use the {source}: it is a panorama ({panorama}), which no perspective camera "
            f"took; cut a perspective view with the people from it, and give that"
        )
    # what the decoder has not reduced itself
    left = factor // max(1, round(max(stored) / max(image.size)))
    with wrap_decoding_errors(source):
        rgb, conversions = _to_rgb(image, left, deep, colours, source)
    thumbnail = share_of_thumbnail(image, rgb)
    if orientation != 1:
        rgb = np.array(Image.fromarray(rgb).transpose(_UPRIGHT[orientation]))
        notes.append("rotated upright by the orientation in the file")
    notes += conversions
    height, width = rgb.shape[:2]
    if factor > 1:
        notes.append(
            f"{stored[0] * stored[1] / 1e6:.0f} megapixels were read at {width} x {height} px"
        )
    stretched = stretched_pixel_note(image.info, tags, stored, orientation)
    intrinsics, focal_notes = intrinsics_from_exif(
        {} if stretched else tags,
        stored,
        width,
        height,
        orientation,
        thumbnail,
        was_encoded_anew(image),
    )
    notes += [exif_note, *focal_notes, drone_note(xmp)]
    upright = stored[::-1] if swaps_sides(orientation) else stored
    return Photo(
        rgb,
        intrinsics,
        tuple(filter(None, notes)),
        upright if factor > 1 else None,
        warnings=(stretched,) if stretched else (),
        up=up_of_gimbal(xmp, orientation),
    )


def _frame_notes(image: Image.Image) -> tuple[str, ...]:
    try:
        several = bool(getattr(image, "is_animated", False))
    except Exception:  # Pillow looks for the second frame, which may be damaged: it is not used
        several = True
    # The MPO file of a phone has a preview or a depth image after the photo, which is not needed.
    return ("only the first of its frames is used",) if several and image.format != "MPO" else ()


def _read_xmp(image: Image.Image) -> str:
    """Return the XMP data of a file, "" without any."""
    xmp = image.info.get("xmp") or image.info.get("XML:com.adobe.xmp") or ""
    return xmp.decode("latin-1") if isinstance(xmp, bytes) else str(xmp)


def _has_16_bits(image: Image.Image) -> bool:
    """Return whether the file has 16 bits per channel, which Pillow keeps only for grey images."""
    if image.mode.startswith("I"):
        return True
    tiles = getattr(image, "tile", None) or ()
    return any(";16" in str(tile[3]) for tile in tiles)


def _exif(image: Image.Image) -> tuple[int, dict[int, Any], str]:
    """Return the orientation still to be applied, the tags of both EXIF directories, and a note if
    they are ignored.
    """
    size = len(image.info.get("exif") or b"")
    if size > _MAX_EXIF_BYTES:
        return 1, {}, f"the EXIF data were ignored: they are {size / 1e6:.0f} MB"
    try:
        with wrap_decoding_errors(ImageSource("")):
            exif = image.getexif()
            orientation = exif.get(ORIENTATION, 1)
            tags = {**exif, **exif.get_ifd(EXIF_IFD), **exif.get_ifd(INTEROPERABILITY_IFD)}
    except InputError:
        return 1, {}, ""  # the pixels are valid: a damaged EXIF block only loses the focal length
    return (orientation if orientation in _UPRIGHT else 1), tags, ""


def _to_rgb(
    image: Image.Image,
    factor: int,
    deep: bool,
    colours: tuple[int, int] | None,
    source: ImageSource,
) -> tuple[UInt8Array, list[str]]:
    """Convert any Pillow mode to RGB (H, W, 3), downscaled by an integer factor, with a note for
    each conversion.
    """
    width, height = image.size
    rows = max(1, _BAND_PIXELS // width // factor) * factor
    rgb = np.empty((math.ceil(height / factor), math.ceil(width / factor), 3), np.uint8)
    transparent = False
    convertible, convert, colour_note = srgb_conversion(image, colours)
    is_converted = False
    for top in range(0, height, rows):
        box = (0, top, width, min(height, top + rows))
        band = image if rows >= height else image.crop(box)
        if band.mode.startswith("I"):
            band = _grey_from_deep(band, source)
        if band.has_transparency_data or band.mode in ("La", "RGBa"):
            band, is_transparent = _composite_on_gray(band)
            transparent |= is_transparent
        if band.mode not in ("RGB", convertible):
            band = band.convert("RGB")
        if convert is not None and band.mode == convertible:
            band = convert(band)
            is_converted = True
        band = band.convert("RGB")
        rgb[top // factor : math.ceil(box[3] / factor)] = np.asarray(
            band.reduce(factor) if factor > 1 else band
        )
    notes = {
        "16 bits per channel were scaled to 8": deep,
        "transparent parts were composited over mid-gray": transparent,
        "CMYK colors were converted to RGB without a color profile": (
            image.mode == "CMYK" and not is_converted
        ),
        colour_note: bool(colour_note),
        "the photo is gray: its one channel is used for red, green and blue": (
            image.mode in ("1", "L", "LA", "La") or image.mode.startswith("I")
        ),
    }
    return rgb, [note for note, is_true in notes.items() if is_true]


def _composite_on_gray(image: Image.Image) -> tuple[Image.Image, bool]:
    """Return a picture with transparency over mid-gray, and whether any pixel is transparent."""
    image = image.convert("RGBA")
    if np.asarray(image.getchannel("A")).min() == 255:
        return image, False
    grey = Image.new("RGBA", image.size, (128, 128, 128, 255))
    return Image.alpha_composite(grey, image), True


def _grey_from_deep(image: Image.Image, source: ImageSource) -> Image.Image:
    values = np.asarray(image)
    if values.size and (values.min() < 0 or values.max() > 65535):
        raise InputError(
            f"cannot use the {source}: its pixels have 32 bits; save it with 8 bits per channel"
        )
    return Image.fromarray(((values.astype(np.uint32) + 128) // 257).astype(np.uint8))
