"""Photos that are the same picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from physic_core.types import FloatArray, MomentView

_SIZE = 32  # px
_LARGEST = 6.0  # difference of grey levels of one picture, of other size or compression
_GAIN = 2.0  # largest factor on its brightness


def thumbnail(view: MomentView) -> FloatArray:
    """Return the grey levels (32, 32) of a photo, with mean 0."""
    grey = cv2.cvtColor(np.asarray(view.image), cv2.COLOR_RGB2GRAY)
    small = cv2.resize(grey, (_SIZE, _SIZE), interpolation=cv2.INTER_AREA).astype(np.float64)
    grey_levels: FloatArray = small - small.mean()
    return grey_levels


def thumbnails_match(one: FloatArray, two: FloatArray) -> bool:
    """Return whether two thumbnails are of one picture, perhaps of other size, compression or brightness."""
    gain = (one * two).sum() / max((two * two).sum(), 1e-9)
    return bool(np.abs(one - gain * two).max() < _LARGEST and 1 / _GAIN < gain < _GAIN)
