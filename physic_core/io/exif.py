"""Read camera intrinsics from the EXIF data of a photo."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import TYPE_CHECKING

from physic_core.types import CameraTrust, Intrinsics

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

ORIENTATION = 0x0112
MAKE = 0x010F
_SOFTWARE = 0x0131
EXIF_IFD = 0x8769
FOCAL_LENGTH = 0x920A
_FOCAL_LENGTH_35MM = 0xA405
_DIGITAL_ZOOM = 0xA404
_PIXEL_WIDTH = 0xA002
_PIXEL_HEIGHT = 0xA003
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
_EDITED_SIGMA = 0.05  # log focal length that two tags of an edited file state: half of _AGREEMENT
_SENSOR_ASPECTS = (4 / 3, 3 / 2)
_ASPECT_ERROR = 0.02  # 4608 x 3456, 6048 x 4024: cameras leave a few rows out
_EDITORS = re.compile(
    "photo|lightroom|camera raw|elements|gimp|snapseed|picasa|capture one|darktable|rawtherapee|"
    "luminar|affinity|irfanview|viewer|pixelmator|vsco|instagram|imagemagick|polarr|digikam|"
    "acdsee|acd systems|paint|aperture|viewnx|capture nx|nx studio|workspace|silkypix|dxo|corel|"
    "canva|picsart|facetune|fotor|pixlr|topaz|krita|meitu|zoner",
    re.IGNORECASE,
)
"""Names of programs that crop or resize photos and keep the tags of the camera."""


def swaps_sides(orientation: int) -> bool:
    """Return whether an EXIF orientation (1-8) swaps width and height."""
    return orientation in (5, 6, 7, 8)


def intrinsics_from_exif(
    tags: Mapping[int, Any], stored: tuple[int, int], width: int, height: int, orientation: int = 1
) -> tuple[Intrinsics | None, tuple[str, ...]]:
    """Compute the intrinsics of the upright photo from its EXIF tags.

    The focal length is that of ``FocalLengthIn35mmFilm``, relative to the diagonal of the 36 x 24
    mm frame, or otherwise of ``FocalLength`` and the resolution of the focal plane. Where both
    agree, the photo is as the camera wrote it, since a crop or a resize changes only one of them;
    if an editor saved it, they are an estimate. A single one counts unless the software is an
    editor or the tagged pixel size is not the file's. A single equivalent also needs the aspect of
    a sensor, since cameras that crop photos to 16:9 or a square state the equivalent of the whole
    sensor.

    A digital zoom lengthens the focal length of the lens. An equivalent may have it already, which
    the resolution of the focal plane shows it, or a sensor that would be smaller than any; Apple's
    always has.

    Args:
        tags: of the first IFD and of the Exif IFD, tag number -> value.
        stored: (width, height) px of the stored pixel grid, before rotation or resizing.
        width: of the upright photo at the size that is used, px.
        height: of the upright photo at the size that is used, px.
        orientation: EXIF orientation, 1-8.

    Returns:
        The intrinsics, or None if the tags do not determine them; and notes on a focal length that
        was ignored, zoomed or is not known exactly.
    """
    zoom = _zoom(tags)
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
    if reason := _doubt(tags, stored, focal, plane if equivalent else None):
        return None, (f"the focal length in the EXIF data was ignored: {reason}",)
    scale = max(width, height) / max(stored)
    fx, fy = (scale * f for f in (focal[::-1] if swaps_sides(orientation) else focal))
    camera = Intrinsics(
        fx, fy, (width - 1) / 2, (height - 1) / 2, width, height, source, CameraTrust.KNOWN
    )
    notes = []
    if zoom != 1:
        notes.append(f"the focal length is that of the photo with its digital zoom of {zoom:g}")
    if math.prod(stored) < _CAMERA_PIXELS and not (plane and equivalent):
        notes.append(
            "the file is smaller than cameras write: if it was cropped, the focal length in its "
            "EXIF data is too short; give --focal-px"
        )
    if editor := _EDITORS.search(str(tags.get(_SOFTWARE))):
        notes.append(
            f"the focal length in the EXIF data may be off by {_EDITED_SIGMA:.0%}: an editor saved "
            f"the photo ({editor[0]})"
        )
        camera = replace(camera, trust=CameraTrust.ESTIMATED, focal_sigma=_EDITED_SIGMA)
    return camera, tuple(notes)


def _zoom(tags: Mapping[int, Any]) -> float:
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


def _doubt(
    tags: Mapping[int, Any],
    stored: tuple[int, int],
    focal: tuple[float, float],
    other: tuple[float, float] | None,
) -> str:
    """Return why a focal length, px, cannot be believed, or "".

    Args:
        tags: as in :func:`intrinsics_from_exif`.
        stored: as there.
        focal: by the 35 mm equivalent, or by the sensor's resolution if there is no equivalent.
        other: by the sensor's resolution, if ``focal`` is by the equivalent.
    """
    share = max(focal) / max(stored)
    if not _FOCAL_RANGE[0] <= share <= _FOCAL_RANGE[1]:
        return f"{share:.2g} times the long side is not plausible"
    by_film = positive_number(tags.get(_FOCAL_LENGTH_35MM)) is not None
    written = [positive_number(tags.get(tag)) or 0.0 for tag in (_PIXEL_WIDTH, _PIXEL_HEIGHT)]
    # some software turns the pixels, but not the tags
    pairs = zip(sorted(written), sorted(stored), strict=True)
    if (all(written) or not by_film) and any(
        abs(tagged / side - 1) > _SAME_SIZE for tagged, side in pairs
    ):
        tagged = f"{written[0]:.0f} x {written[1]:.0f} px"
        return (
            f"its tags state {tagged}, but the file has {stored[0]} x {stored[1]} px, as after "
            f"a crop or a resize"
        )
    if other:
        if abs(math.log(max(other) / max(focal))) < _AGREEMENT:
            return ""
        return (
            "the 35 mm equivalent and the sensor's resolution differ, as after a crop or a resize"
        )
    if editor := _EDITORS.search(str(tags.get(_SOFTWARE))):
        return f"the photo was saved by an editor ({editor[0]}), which may have cropped it"
    sensor_mm = max(stored) * (positive_number(tags.get(FOCAL_LENGTH)) or 0.0) / max(focal)
    zoom = _zoom(tags)
    has_zoom = 0 < sensor_mm < _SENSOR_MM[0] or "Apple" in str(tags.get(MAKE))
    if by_film and zoom != 1 and not has_zoom:
        return f"whether the 35 mm equivalent has the digital zoom of {zoom:g} cannot be told"
    sensor_mm *= 1 if by_film else zoom
    aspect = max(stored) / min(stored)
    if by_film and all(
        abs(aspect / of_sensor - 1) > _ASPECT_ERROR for of_sensor in _SENSOR_ASPECTS
    ):
        return f"sides of {aspect:.2f}:1 are of no usual sensor, so the photo may have been cropped"
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
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) and number > 0 else None
