"""Read camera intrinsics from the EXIF data of a photo."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from physic_core.types import CameraTrust, Intrinsics

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

ORIENTATION = 0x0112
MAKE = 0x010F
EXIF_IFD = 0x8769
FOCAL_LENGTH = 0x920A
_FOCAL_LENGTH_35MM = 0xA405
_DIGITAL_ZOOM = 0xA404
INTEROPERABILITY_IFD = 0xA005
_SIZES = {"of the Exif data": (0xA002, 0xA003), "of the file": (0x0100, 0x0101)}
_OF_CAMERA = (0x1001, 0x1002)  # interoperability: the size of the photo that the camera wrote
_CHANGED, _TAKEN = 0x0132, 0x9003  # date and time
_MAKER_NOTE = 0x927C
_PLANE_X = 0xA20E
_PLANE_Y = 0xA20F
_PLANE_UNIT = 0xA210

_FULL_FRAME_DIAGONAL_MM = math.hypot(36.0, 24.0)
"""Diagonal of a 36 x 24 mm frame: CIPA DCG-001 defines the 35 mm equivalent by equal diagonals."""

_UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
_FOCAL_RANGE = (0.3, 15.0)  # of the long side: a 118 degree lens to a 4 degree one
# In long sides: a longer focal length needs a 35 mm equivalent and a plausible sensor.
_MAX_FOCAL_BY_ONE = 6.0
_SENSOR_MM = (4.0, 56.0)  # width, from small phones to medium format
# Of the logarithms of two focal lengths: one is in whole mm, and sensors are a few % off their
# nominal size.
_AGREEMENT = 0.1
_SAME_SIZE = 0.01  # relative difference of two sides that are one
_CAMERA_PIXELS = 1_900_000  # cameras that state a focal length write larger photos
_CAMERA_STEP = 4  # px: sides of the photos of cameras and phones are multiples of it
_ONE_TAG_SIGMA = 0.1
"""Standard deviation of the logarithm of a focal length by one tag.

A whole photo is off by 3 to 5 %, and a crop whose tags were rewritten by 30 % and more: 1 of 94
files of cameras and programs.
"""
_WHOLE = 0.95  # share of the side of a thumbnail that a whole photo shows
_SENSOR_ASPECTS = (4 / 3, 3 / 2)
_ASPECT_ERROR = 0.02  # 4608 x 3456, 6048 x 4024: cameras leave a few rows out


def swaps_sides(orientation: int) -> bool:
    """Return whether an EXIF orientation (1-8) swaps width and height."""
    return orientation in (5, 6, 7, 8)


def intrinsics_from_exif(
    tags: Mapping[int, Any],
    stored: tuple[int, int],
    width: int,
    height: int,
    orientation: int = 1,
    thumbnail: float | None = None,
    encoded_anew: bool = False,
) -> tuple[Intrinsics | None, tuple[str, ...]]:
    """Compute the intrinsics of the upright photo from its EXIF tags.

    The focal length is that of ``FocalLengthIn35mmFilm``, relative to the diagonal of the 36 x 24
    mm frame, or otherwise of ``FocalLength`` and the resolution of the focal plane. Programs that
    crop a photo keep both, and may rewrite its size. The focal length is known only if a second
    witness says that the photo is as the camera wrote it: both tags agree, since a crop or a resize
    changes only one of them, the thumbnail shows the same, or the camera's own size is the file's.
    A program that crops may write the latter two anew. They count only in a file as cameras write
    it: with a maker note, without a later date of change, and without JFIF headers.
    Otherwise it is an estimate. It is ignored if a stated size is not the file's, if no camera
    writes such a size, and if the thumbnail shows more. A single equivalent also needs the aspect
    of a sensor, since cameras that crop photos to 16:9 or a square state the equivalent of the
    whole sensor.

    A digital zoom lengthens the focal length of the lens. An equivalent may have it already, which
    the resolution of the focal plane shows it, or a sensor that would be smaller than any; Apple's
    always has.

    Args:
        tags: of the first IFD, and of those of Exif and of interoperability, tag number -> value.
        stored: (width, height) px of the stored pixel grid, before rotation or resizing.
        width: of the upright photo at the size that is used, px.
        height: of the upright photo at the size that is used, px.
        orientation: EXIF orientation, 1-8.
        thumbnail: share of the thumbnail's side that the photo shows; None without one.
        encoded_anew: whether the file or its thumbnail has a header that cameras do not write.

    Returns:
        The intrinsics, or None if the tags do not determine them; and notes on a focal length that
        was ignored, zoomed or is not known exactly.
    """
    zoom = _digital_zoom(tags)
    plane = _plane_focal(tags, zoom)
    equivalent = positive_number(tags.get(_FOCAL_LENGTH_35MM))
    if equivalent:
        shared = equivalent * math.hypot(*stored) / _FULL_FRAME_DIAGONAL_MM
        if plane:
            shared = min(shared, shared * zoom, key=lambda f: abs(math.log(f / max(plane))))
        focal = (shared, shared)
        source = f"EXIF: {equivalent:g} mm (35 mm equivalent, by the diagonal)"
    elif plane:
        focal = plane
        focal_mm = positive_number(tags.get(FOCAL_LENGTH))
        source = f"EXIF: {focal_mm:g} mm and the sensor's resolution"
    else:
        return None, ()
    other = plane if equivalent else None
    reason = _crop_note(tags, stored, thumbnail) or _focal_doubt(
        tags, stored, focal, other, resized=equivalent is not None and thumbnail is not None
    )
    if reason:
        return None, (f"the focal length in the EXIF data was ignored: {reason}",)
    scale = max(width, height) / max(stored)
    fx, fy = (scale * f for f in (focal[::-1] if swaps_sides(orientation) else focal))
    camera = Intrinsics(
        fx, fy, (width - 1) / 2, (height - 1) / 2, width, height, source, CameraTrust.KNOWN
    )
    notes = []
    if zoom != 1:
        notes.append(f"the focal length is that of the photo with its digital zoom of {zoom:g}")
    is_as_taken = not encoded_anew and _MAKER_NOTE in tags and not _was_changed(tags)
    shows_whole = thumbnail is not None or all(_tag_numbers(tags, _OF_CAMERA))
    if not (other or (is_as_taken and shows_whole)):
        camera = replace(camera, trust=CameraTrust.ESTIMATED, focal_sigma=_ONE_TAG_SIGMA)
        notes.append(
            f"the focal length comes from one EXIF tag, which cropping programs keep: it may be "
            f"off by {_ONE_TAG_SIGMA:.0%}, and is too short if the photo was cropped. Give the "
            f"original file, or --focal-px PX"
        )
    return camera, tuple(notes)


def _was_changed(tags: Mapping[int, Any]) -> bool:
    """Return whether the tags date a change of the file after the photo was taken."""
    dates = [str(tags.get(tag) or "").strip("\0 ") for tag in (_CHANGED, _TAKEN)]
    return all(dates) and dates[0] != dates[1]


def _tag_numbers(tags: Mapping[int, Any], pair: tuple[int, int]) -> list[float]:
    """Return the shorter and the longer side that two tags state, 0 for none."""
    return sorted(positive_number(tags.get(tag)) or 0.0 for tag in pair)


def _crop_note(tags: Mapping[int, Any], stored: tuple[int, int], thumbnail: float | None) -> str:
    """Return why a file is not the whole photo of a camera, or ""; software may turn the pixels,
    but not the tags.
    """
    if thumbnail is not None and thumbnail < _WHOLE:
        return (
            f"its thumbnail shows more, so it was cropped to {thumbnail:.0%} of its width or height"
        )
    for words, pair in (*_SIZES.items(), ("of the camera's photo", _OF_CAMERA)):
        size = _tag_numbers(tags, pair)
        if all(size) and any(
            abs(one / side - 1) > _SAME_SIZE for one, side in zip(size, sorted(stored), strict=True)
        ):
            return (
                f"its tags state {size[1]:.0f} x {size[0]:.0f} px {words}, but it has {stored[0]} "
                f"x {stored[1]} px, as after a crop or a resize"
            )
    return ""


def _digital_zoom(tags: Mapping[int, Any]) -> float:
    zoom = positive_number(tags.get(_DIGITAL_ZOOM)) or 1.0
    return zoom if abs(zoom - 1) > _SAME_SIZE else 1.0


def _plane_focal(tags: Mapping[int, Any], zoom: float) -> tuple[float, float] | None:
    """Return the focal lengths along the stored axes by the resolution of the focal plane and the
    digital zoom, px; None if not known.
    """
    focal_mm = positive_number(tags.get(FOCAL_LENGTH))
    plane_x = positive_number(tags.get(_PLANE_X))
    unit_mm = _UNIT_MM.get(int(positive_number(tags.get(_PLANE_UNIT)) or 2))
    if not focal_mm or not plane_x or unit_mm is None:
        return None
    plane_y = positive_number(tags.get(_PLANE_Y)) or plane_x
    if abs(math.log(plane_x / plane_y)) > _AGREEMENT:  # no sensor has such pixels
        return None
    return zoom * focal_mm * plane_x / unit_mm, zoom * focal_mm * plane_y / unit_mm


def _focal_doubt(
    tags: Mapping[int, Any],
    stored: tuple[int, int],
    focal: tuple[float, float],
    other: tuple[float, float] | None,
    *,
    resized: bool,
) -> str:
    """Return why a focal length, px, cannot be believed, or "".

    Args:
        tags: as in :func:`intrinsics_from_exif`.
        stored: as there.
        focal: by the 35 mm equivalent, or by the sensor's resolution if there is no equivalent.
        other: by the sensor's resolution, if ``focal`` is by the equivalent.
        resized: whether the file shows the whole photo at any size, which the equivalent allows.
    """
    share = max(focal) / max(stored)
    if not _FOCAL_RANGE[0] <= share <= _FOCAL_RANGE[1]:
        return f"{share:.2g} times the long side is not plausible"
    by_film = positive_number(tags.get(_FOCAL_LENGTH_35MM)) is not None
    if other:
        if abs(math.log(max(other) / max(focal))) < _AGREEMENT:
            return ""
        return (
            "the 35 mm equivalent and the sensor's resolution differ, as after a crop or a resize"
        )
    if not resized and any(side % _CAMERA_STEP for side in stored):
        return f"no camera writes {stored[0]} x {stored[1]} px, so it was cropped or resized"
    if not by_film and math.prod(stored) < _CAMERA_PIXELS:
        return (
            f"cameras that write this tag have more than {stored[0]} x {stored[1]} px, so it was "
            f"cropped or resized"
        )
    sensor_mm = max(stored) * (positive_number(tags.get(FOCAL_LENGTH)) or 0.0) / max(focal)
    zoom = _digital_zoom(tags)
    has_zoom = 0 < sensor_mm < _SENSOR_MM[0] or "Apple" in str(tags.get(MAKE))
    if by_film and zoom != 1 and not has_zoom:
        return f"it is not known whether the 35 mm equivalent includes the digital zoom of {zoom:g}"
    sensor_mm *= 1 if by_film else zoom
    aspect = max(stored) / min(stored)
    if all(abs(aspect / of_sensor - 1) > _ASPECT_ERROR for of_sensor in _SENSOR_ASPECTS):
        return f"no usual sensor has sides of {aspect:.2f}:1, so the photo may have been cropped"
    is_sensor = _SENSOR_MM[0] <= sensor_mm <= _SENSOR_MM[1]
    if (by_film and is_sensor) or (share <= _MAX_FOCAL_BY_ONE and (by_film or is_sensor)):
        return ""
    return (
        f"{share:.2g} times the long side, with a sensor {sensor_mm:.2g} mm wide, needs a "
        f"second tag that agrees"
    )


def positive_number(value: Any) -> float | None:
    """Convert an EXIF tag to a positive finite number; None for 0, 0/0 and text, which mean
    "unknown".
    """
    try:
        number = float(value)
    except (TypeError, ValueError, ArithmeticError):
        return None
    return number if math.isfinite(number) and number > 0 else None
