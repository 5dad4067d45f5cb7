"""Compare a photo with the thumbnail in its EXIF data, which shows more if it was cropped."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
from PIL import ExifTags, Image

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import UInt8Array

_OFFSET, _LENGTH = 0x0201, 0x0202  # tags of its JPEG
_HEAD = b"Exif\0\0"
_SIDE = 80  # of the compared thumbnail, px
_BLACK = 24  # of bars beside a picture of another shape, of 255
_SHARES = np.arange(1.0, 0.34, -0.02)
_SAME = 0.9  # correlation of a photo with its place in the thumbnail
_TEXTURE = 4.0  # deviation of a picture that can be compared


def share_of_thumbnail(image: Image.Image, stored: UInt8Array) -> float | None:
    """Return the share of the thumbnail's side that a photo shows; None without one, and if it does
    not show the photo.

    Args:
        image: as opened.
        stored: (H, W, 3) its pixels, as they are stored.
    """
    import cv2

    grey = _thumbnail(image)
    if grey is None:
        return None
    photo = cv2.cvtColor(stored, cv2.COLOR_RGB2GRAY)
    unit = _SIDE / max(grey.shape)
    small = _resized(grey, unit)
    fit = min(s / p for s, p in zip(small.shape, photo.shape, strict=True))
    correlations = [(_correlation(small, _resized(photo, fit * s)), s) for s in _SHARES]
    best, share = max(correlations)
    return float(share) if best >= _SAME else None


def _resized(grey: NDArray[np.uint8], factor: float) -> NDArray[np.float32]:
    import cv2

    width, height = (max(8, round(side * factor)) for side in grey.shape[::-1])
    resized = cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(resized, np.float32)


def _correlation(whole: NDArray[np.float32], part: NDArray[np.float32]) -> float:
    """Return the largest correlation of a part with a place in the whole."""
    import cv2

    part = part[: whole.shape[0], : whole.shape[1]]
    if part.std() < _TEXTURE:
        return 0.0
    return float(cv2.matchTemplate(whole, part, cv2.TM_CCOEFF_NORMED).max())


def _thumbnail(image: Image.Image) -> NDArray[np.uint8] | None:
    """Return the grey thumbnail (h, w) of a JPEG without black bars; None without one that can be
    read.
    """
    data = image.info.get("exif") or b""
    try:
        tags = image.getexif().get_ifd(ExifTags.IFD.IFD1)
        start = int(tags[_OFFSET]) + len(_HEAD) * data.startswith(_HEAD)
        with Image.open(io.BytesIO(data[start : start + int(tags[_LENGTH])])) as thumbnail:
            grey = np.asarray(thumbnail.convert("L"))
    except Exception:  # Pillow raises many classes for damaged data: it is no witness then
        return None
    lit = grey > _BLACK
    rows, columns = (np.flatnonzero(lit.mean(axis) > 0.1) for axis in (1, 0))
    if not len(rows) or not len(columns):
        return None
    return grey[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
