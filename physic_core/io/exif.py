"""Read camera intrinsics from the EXIF data of a photo."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from physic_core.types import CameraTrust, Intrinsics

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

ORIENTATION = 0x0112
EXIF_IFD = 0x8769
_FOCAL_LENGTH = 0x920A
_FOCAL_LENGTH_35MM = 0xA405
_PIXEL_WIDTH, _PIXEL_HEIGHT = 0xA002, 0xA003
_PLANE_X, _PLANE_Y, _PLANE_UNIT = 0xA20E, 0xA20F, 0xA210

_FULL_FRAME_DIAGONAL_MM = math.hypot(36.0, 24.0)
"""Diagonal of a 36 x 24 mm frame: CIPA DCG-001 defines the 35 mm equivalent by equal diagonals."""

_UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
_FOCAL_RANGE = (0.3, 15.0)  # of the long side: a 118 degree lens to a 4 degree one


def swaps_sides(orientation: int) -> bool:
    """Whether an EXIF orientation (1-8) swaps width and height."""
    return orientation in (5, 6, 7, 8)


def intrinsics_from_exif(
    tags: Mapping[int, Any], stored: tuple[int, int], width: int, height: int, orientation: int = 1
) -> tuple[Intrinsics | None, str | None]:
    """Compute the intrinsics of the upright photo from its EXIF tags.

    ``FocalLengthIn35mmFilm`` has priority, relative to the diagonal of the 36 x 24 mm frame. Otherwise ``FocalLength``
    is used with the resolution of the focal plane.

    Args:
        tags: the Exif IFD, tag number -> value.
        stored: (width, height) px of the stored pixel grid, before rotation or resizing.
        width: of the upright photo at the size that is used, px.
        height: of the upright photo at the size that is used, px.
        orientation: EXIF orientation, 1-8.

    Returns:
        The intrinsics, or None if the tags do not determine them; and a note if a focal length was ignored, else None.
    """
    focal = _focal_px(tags, stored, width, height, orientation)
    if focal is None:
        return None, None
    fx, fy, source = focal
    original = _number(tags.get(_PIXEL_WIDTH)), _number(tags.get(_PIXEL_HEIGHT))
    if original[0] and original[1] and not _same_shape((original[0], original[1]), stored):
        return None, (
            f"the focal length in the EXIF data was ignored: it is for {original[0]:.0f} x {original[1]:.0f} px, "
            f"but the file has {stored[0]} x {stored[1]} px, so the photo was cropped"
        )
    share = max(fx, fy) / max(width, height)
    if not _FOCAL_RANGE[0] <= share <= _FOCAL_RANGE[1]:
        return None, f"the focal length in the EXIF data was ignored: {share:.2g} times the long side is not plausible"
    camera = Intrinsics(fx, fy, (width - 1) / 2, (height - 1) / 2, width, height, source, CameraTrust.KNOWN)
    return camera, None


def _focal_px(
    tags: Mapping[int, Any], stored: tuple[int, int], width: int, height: int, orientation: int
) -> tuple[float, float, str] | None:
    equivalent = _number(tags.get(_FOCAL_LENGTH_35MM))
    if equivalent:
        focal = equivalent * math.hypot(width, height) / _FULL_FRAME_DIAGONAL_MM
        return focal, focal, f"EXIF: {equivalent:g} mm (35 mm equivalent, by the diagonal)"
    focal_mm, plane_x = _number(tags.get(_FOCAL_LENGTH)), _number(tags.get(_PLANE_X))
    unit_mm = _UNIT_MM.get(int(_number(tags.get(_PLANE_UNIT)) or 2))
    if not focal_mm or not plane_x or unit_mm is None:
        return None
    plane_y = _number(tags.get(_PLANE_Y)) or plane_x
    # The resolution counts the pixels that the camera wrote, which a later resize has changed.
    written = _number(tags.get(_PIXEL_WIDTH)) or stored[0], _number(tags.get(_PIXEL_HEIGHT)) or stored[1]
    along_x = focal_mm * plane_x / unit_mm / written[0]  # focal over the stored width
    along_y = focal_mm * plane_y / unit_mm / written[1]
    if swaps_sides(orientation):
        along_x, along_y = along_y, along_x
    return along_x * width, along_y * height, f"EXIF: {focal_mm:g} mm and the sensor's resolution"


def _same_shape(original: tuple[float, float], stored: tuple[int, int]) -> bool:
    """Whether two aspect ratios are equal within 2 %, also after a rotation by 90 degrees.

    Some software rotates the pixels without changing the tags.
    """
    aspects = original[0] / original[1], original[1] / original[0]
    return any(abs(aspect * stored[1] / stored[0] - 1.0) < 0.02 for aspect in aspects)


def _number(value: Any) -> float | None:
    """Convert an EXIF tag to a positive finite number; None for 0, 0/0 and text, which mean "unknown"."""
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) and number > 0 else None
