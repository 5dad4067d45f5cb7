"""Compare a photo with the thumbnail in its EXIF data, which shows more if it was cropped."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
from PIL import ExifTags, Image

if TYPE_CHECKING:
    from physic_core.types import Float32Array, UInt8Array


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

    thumbnail = _open_thumbnail(image)
    if thumbnail is None:
        return None
    grey = _without_bars(np.asarray(thumbnail.convert("L")))
    if grey is None:
        return None
    photo = cv2.cvtColor(stored, cv2.COLOR_RGB2GRAY)
    unit = _SIDE / max(grey.shape)
    small = _resized(grey, unit)
    fit = min(s / p for s, p in zip(small.shape, photo.shape, strict=True))
    correlations = [(_correlation(small, _resized(photo, fit * s)), s) for s in _SHARES]
    best, share = max(correlations)
    return float(share) if best >= _SAME else None


def was_encoded_anew(image: Image.Image) -> bool:
    """Return whether a JPEG, as opened, or its thumbnail begins with a header of JFIF or of a
    program. Exif forbids both, and cameras write none.
    """
    thumbnail = _open_thumbnail(image)
    return "jfif" in image.info or bool(getattr(thumbnail, "applist", ()))


def _resized(grey: UInt8Array, factor: float) -> Float32Array:
    import cv2

    width, height = (max(8, round(side * factor)) for side in grey.shape[::-1])
    resized = cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(resized, np.float32)


def _correlation(whole: Float32Array, part: Float32Array) -> float:
    """Return the largest correlation of a part with a place in the whole."""
    import cv2

    part = part[: whole.shape[0], : whole.shape[1]]
    if part.std() < _TEXTURE:
        return 0.0
    return float(cv2.matchTemplate(whole, part, cv2.TM_CCOEFF_NORMED).max())


def _open_thumbnail(image: Image.Image) -> Image.Image | None:
    """Return the thumbnail of a JPEG; None without one that can be read."""
    data = image.info.get("exif") or b""
    try:
        tags = image.getexif().get_ifd(ExifTags.IFD.IFD1)
        start = int(tags[_OFFSET]) + len(_HEAD) * data.startswith(_HEAD)
        thumbnail = Image.open(io.BytesIO(data[start : start + int(tags[_LENGTH])]))
        thumbnail.load()
    except Exception:  # Pillow raises many classes for damaged data: it is no witness then
        return None
    return thumbnail


def _without_bars(grey: UInt8Array) -> UInt8Array | None:
    """Return the grey thumbnail (h, w) without black bars; None if it is black."""
    lit = grey > _BLACK
    rows, columns = (np.flatnonzero(lit.mean(axis) > 0.1) for axis in (1, 0))
    if not len(rows) or not len(columns):
        return None
    return grey[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
