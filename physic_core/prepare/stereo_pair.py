"""Find a photo that shows the same from two places, side by side or one over the other: a stereo
card.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from physic_core.io.photo import MIN_SIDE

if TYPE_CHECKING:
    from physic_core.types import FloatArray, UInt8Array

_TWIN_SIDE = 240
_BLOCK = 24
_SHIFT = 0.12  # of the width of a half: largest disparity of two views
_TWINS = 0.72  # median correlation of the blocks of two views
_TEXTURE = 4.0
_TEXTURED = 0.3
_SEAM = 0.55  # share of the rows with a step in the middle
_PLAIN = 6  # deviation of the colours of a strip between them, of 255


def half_of_stereo_pair(image: UInt8Array) -> tuple[int, int] | None:
    """Return the axis and the length of the half of an image (H, W, 3) if both halves show the
    same, side by side or one over the other; None if not.
    """
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    for axis in (1, 0):
        across = image if axis == 1 else image.transpose(1, 0, 2)
        height, width = across.shape[:2]
        gap = _gap_width(across)
        half = (width - gap) // 2
        if half < MIN_SIDE:
            continue
        scale = _TWIN_SIDE / max(height, half)
        size = max(_BLOCK, round(half * scale)), max(_BLOCK, round(height * scale))
        whole = grey if axis == 1 else grey.T
        halves = [
            cv2.resize(np.ascontiguousarray(part), size, interpolation=cv2.INTER_AREA).astype(
                np.float32
            )
            for part in (whole[:, :half], whole[:, -half:])
        ]
        views = halves if axis == 1 else [one.T for one in halves]
        if _stereo_correlation(*(np.ascontiguousarray(one) for one in views)) >= _TWINS and (
            gap or _has_seam(across)
        ):
            return axis, half
    return None


def _gap_width(image: UInt8Array) -> int:
    """Return the width of a strip of one colour in the middle of an image (H, W, 3), px."""
    middle = image.shape[1] // 2
    reach = image.shape[1] // 16
    columns = image[:: max(1, len(image) // _TWIN_SIDE), middle - reach : middle + reach]
    plain = columns.astype(np.int16).std(0).max(-1) <= _PLAIN
    if not plain[reach]:
        return 0
    # 0 where no column up to the end of the strip is another one
    before = reach - int(plain[reach::-1].argmin())
    after = reach + int(plain[reach:].argmin())
    return max(0, int(after - before - 1))


def _has_seam(image: UInt8Array) -> bool:
    """Return whether two pictures meet in the middle of an image (H, W, 3): the step there is
    larger than those beside it in most rows.
    """
    middle = image.shape[1] // 2
    steps = np.abs(np.diff(image[:, middle - 8 : middle + 8].astype(np.int16), axis=1)).sum(-1)
    largest = steps[:, 5:10].max(1)
    beside = np.concatenate([steps[:, :4], steps[:, 11:]], axis=1).max(1)
    return bool((largest > beside).mean() >= _SEAM)


def _stereo_correlation(left: FloatArray, right: FloatArray) -> float:
    """Return the median correlation of the blocks of one view (H, W) with those of the other, each
    at its best place nearby; 0 if few have texture.
    """
    height, width = left.shape
    reach = round(_SHIFT * width)
    slack = max(2, round(0.02 * height))
    wide = cv2.copyMakeBorder(right, slack, slack, reach, reach, cv2.BORDER_REPLICATE)
    agreements = []
    count = 0
    for y in range(0, height - _BLOCK + 1, _BLOCK):
        for x in range(0, width - _BLOCK + 1, _BLOCK):
            count += 1
            block = left[y : y + _BLOCK, x : x + _BLOCK]
            if block.std() >= _TEXTURE:
                around = wide[y : y + _BLOCK + 2 * slack, x : x + _BLOCK + 2 * reach]
                agreements.append(cv2.matchTemplate(around, block, cv2.TM_CCOEFF_NORMED).max())
    return float(np.median(agreements)) if len(agreements) >= _TEXTURED * max(count, 1) else 0.0
