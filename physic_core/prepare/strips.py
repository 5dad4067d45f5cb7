"""Count the pictures in a file that strips of one colour part from edge to edge.

A shrunk copy loses strips of a few pixels, so that each row and column is looked at in full. JPEG
mixes thin strips with the pictures: what counts as an edge grows with what varies along the strip.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import FloatArray, UInt8Array

_SAMPLES = 500  # of a row
_PERCENTILE = 90
_VARIES = 24.0  # largest deviation along a strip, at this percentile, of 255
_SAME = 8.0  # largest difference of the rows of a strip
_EDGE = (8.0, 2.0)  # least step to a picture, and its share of the deviation
_EDGE_ROWS = 4  # beside a strip: JPEG blurs the first
_SEEN = 0.5  # share of a strip's length with such a step, on either side
_STRAY = 0.01  # share of its pixels that have another colour
_LEAST_PX = 2
_WIDEST = 0.1  # of the side, beside the largest of a thin strip
_PART = 0.08  # least side of a picture, of the file's


def count_pictures(image: UInt8Array) -> int:
    """Return the number of pictures in an image (H, W, 3), 1 without a strip: rows times columns of
    them.
    """
    return len(_parts(image)) * len(_parts(image.transpose(1, 0, 2)))


def _parts(across: UInt8Array) -> list[int]:
    """Return the number of rows of each part of an image (H, W, 3) between strips along its
    rows.
    """
    height = len(across)
    ends = [0, *(end for strip in _strips(across) for end in strip), height]
    sides = [stop - start for start, stop in list(pairwise(ends))[::2]]
    return sides if min(sides) >= _PART * height else [height]


def _strips(across: UInt8Array) -> list[tuple[int, int]]:
    """Return first row, and row after the last, of the strips along the rows of an image
    (H, W, 3).
    """
    samples = across[:, :: max(1, across.shape[1] // _SAMPLES)].astype(np.int16)
    color: FloatArray = np.median(samples, axis=1)
    off = np.abs(samples - color[:, None]).max(-1)
    varies: FloatArray = np.percentile(off, _PERCENTILE, axis=1)
    steps = np.abs(np.diff(color, axis=0)).max(-1) > _SAME
    plain = varies <= _VARIES
    begins = np.flatnonzero(plain & np.insert(steps | ~plain[:-1], 0, True))
    stops = np.flatnonzero(plain & np.append(steps | ~plain[1:], True)) + 1
    strips = []
    for start, stop in zip(begins.tolist(), stops.tolist(), strict=True):
        if not _LEAST_PX <= stop - start <= _WIDEST * len(across) + _LEAST_PX:
            continue
        middle = start + int(varies[start:stop].argmin())
        step = _EDGE[0] + _EDGE[1] * varies[middle]
        sides = samples[max(0, start - _EDGE_ROWS) : start], samples[stop : stop + _EDGE_ROWS]
        seen = [
            (np.abs(rows - color[middle]).max(-1) > step).any(0).mean() if len(rows) else 0.0
            for rows in sides
        ]
        if min(seen) >= _SEEN and (off[middle] > step).mean() <= _STRAY:
            strips.append((start, stop))
    return strips
