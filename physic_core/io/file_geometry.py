"""Read what a file states about its picture beside the lens: projection, shape of pixels, drone."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

import numpy as np

from physic_core.io.exif import FOCAL_LENGTH, MAKE, positive_number, swaps_sides

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    from physic_core.types import FloatArray

_ATTRIBUTES = r"""(?:[\w.:-]+\s*=\s*(?:"[^"]*"|'[^']*')\s*)*"""


def _xmp_pattern(prefix: str, name: str, value: str) -> re.Pattern[str]:
    """Return the pattern of a property of XMP, an attribute or an element; text has none."""
    key = f"{prefix}:{name}"
    return re.compile(
        rf"""<[\w.:-]+\s+{_ATTRIBUTES}{key}\s*=\s*["']\s*({value})|<{key}>\s*({value})"""
    )


_NUMBER = r"[+-]?\d+(?:\.\d+)?"
_PROJECTION = _xmp_pattern("GPano", "ProjectionType", r"[\w-]+")
_PITCH = _xmp_pattern("drone-dji", "GimbalPitchDegree", _NUMBER)
_ROLL = _xmp_pattern("drone-dji", "GimbalRollDegree", _NUMBER)
_LEVEL_DEG = 2.0  # of roll; a gimbal keeps the horizon level
_ALTITUDE = _xmp_pattern("drone-dji", "RelativeAltitude", _NUMBER)
_FLAT = ("perspective", "rectilinear")

_RESOLUTIONS = (0x011A, 0x011B)
_CUSTOM_RENDERED = 0xA401
_PANORAMA_OF_APPLE = 6
_OF_CAMERAS = {MAKE, 0x0110, FOCAL_LENGTH}  # 0x0110: model

_SQUARE = math.log(1.02)
_LARGEST = math.log(2.5)  # a more extreme ratio is a mistake in a tag that no program reads
_LINES = {120: 480, 144: 576, 240: 480, 288: 576, 480: 480, 486: 480, 576: 576, 1080: 1080}
"""Height of a frame or a field of video -> lines of the square-pixel picture it shows."""
_SAMPLES = (176, 352, 480, 528, 544, 704, 720, 928, 944, 960)
_SAMPLES_OF_HD = (944, 960, 1280, 1440)
"""Width of a line as ITU-R BT.601 samples it, and the parts of it that DVB, DVD and recorders
(960H) store; of BT.709, those of DVCPRO HD and HDV. All show 4:3 or 16:9, HD 16:9 alone.
"""
_VIDEO = {(1280, 720), (1920, 1080), (2560, 1440), (2592, 1944), (3840, 2160)}
"""Sizes of video of which recorders store half of the columns (720N, lite), or half of the lines, a
field.
"""
_SHAPES_OF_PHOTOS = (4 / 3, 3 / 2, 5 / 4, 2.0)
_PAIRS = ("jfif_density", "aspect", "dpi")


def _xmp_value(pattern: re.Pattern[str], xmp: str) -> str | None:
    match = pattern.search(xmp)
    return None if match is None else match[1] or match[2]


def panorama_kind(xmp: str, tags: Mapping[int, Any]) -> str:
    """Return the projection of a panorama, such as "equirectangular"; "" for a perspective photo.

    Args:
        xmp: of the file.
        tags: as in :func:`physic_core.io.exif.intrinsics_from_exif`.
    """
    if (kind := (_xmp_value(_PROJECTION, xmp) or "").lower()) and kind not in _FLAT:
        return kind
    is_apple = str(tags.get(MAKE)).strip("\0 ") == "Apple"
    return "cylindrical" if is_apple and tags.get(_CUSTOM_RENDERED) == _PANORAMA_OF_APPLE else ""


def up_of_gimbal(xmp: str, orientation: int) -> FloatArray | None:
    """Return the unit vector (3,) against gravity in the camera frame that a drone states; None
    without one.

    DJI's pitch is 0 at the horizon and -90 degrees straight down. The roll is about the axis of the
    camera, whose direction is not documented: with any roll, and for a turned picture, None.

    Args:
        xmp: of the file.
        orientation: EXIF orientation, 1-8.
    """
    pitch, roll = (_xmp_value(pattern, xmp) for pattern in (_PITCH, _ROLL))
    if pitch is None or orientation != 1 or (roll and abs(float(roll)) > _LEVEL_DEG):
        return None
    angle = math.radians(float(pitch))
    return np.array([0.0, -math.cos(angle), math.sin(angle)])


def drone_note(xmp: str) -> str:
    """Return a note on the height over the take-off, or ""."""
    if (altitude := _xmp_value(_ALTITUDE, xmp)) is None:
        return ""
    return (
        f"the drone states {float(altitude):g} m above the take-off, which is not used: give "
        f"--camera-height if people stand at the height of the take-off"
    )


def stretched_pixel_note(
    info: Mapping[Any, Any], tags: Mapping[int, Any], stored: tuple[int, int], orientation: int
) -> str:
    """Return why the pixels of a file are or may not be square, and the resize that mends them; ""
    for square ones.

    Without a unit of length, programs disagree on which number is that of the width. A recorder
    states nothing: it is known by the exact size of its pictures.

    Args:
        info: of Pillow: resolutions of JFIF, PNG and TIFF.
        tags: as in :func:`physic_core.io.exif.intrinsics_from_exif`.
        stored: (width, height) px of the stored pixel grid.
        orientation: EXIF orientation, 1-8.
    """
    of_tags = [tags.get(tag) for tag in _RESOLUTIONS]
    for name, pair in (*((name, info.get(name)) for name in _PAIRS), ("", of_tags)):
        x, y = (positive_number(value) for value in pair or (0, 0))
        if not x or not y or not _SQUARE < abs(math.log(x / y)) < _LARGEST:
            continue
        by_height = (x > y) != swaps_sides(orientation)
        sides = ("height", "width") if by_height else ("width", "height")
        text = (
            f"the file states pixels that are not square ({x:g}:{y:g}): resize it to "
            f"{max(x / y, y / x):.3g} times its {sides[0]}"
        )
        has_unit = name != "aspect" and (name != "jfif_density" or info.get("jfif_unit"))
        return text if has_unit else f"{text}, or {sides[1]} if a video program wrote it"
    return "" if _OF_CAMERAS & tags.keys() else _video_pixel_note(*stored)


def _video_pixel_note(width: int, height: int) -> str:
    """Return why a picture of this size, px, may be a frame of video whose pixels are not square;
    "" for other sizes.
    """
    lines = _LINES.get(height)
    is_hd = lines == 1080
    whole = [size for size in ((2 * width, height), (width, 2 * height)) if size in _VIDEO]
    if whole:
        right = f"to {whole[0][0]} x {whole[0][1]} px"
    elif lines and width != height and width in (_SAMPLES_OF_HD if is_hd else _SAMPLES):
        wide = f"{2 * round(lines * 8 / 9)} x {lines} px"
        right = f"to {wide}"
        if not is_hd:
            right = f"to {lines * 4 // 3} x {lines} px, or {wide} if it has 16:9"
    else:
        return ""
    longer, shorter = max(width, height), min(width, height)
    may_be_photo = any(abs(longer / shorter / shape - 1) < 1e-3 for shape in _SHAPES_OF_PHOTOS)
    unsure = "may not be square: if people look too thin or wide,"
    are = unsure if may_be_photo else "are not square:"
    return f"{width} x {height} px is a size of video, whose pixels {are} resize it {right}"
