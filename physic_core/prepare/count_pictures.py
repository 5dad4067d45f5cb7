"""Count the pictures in a file that strips of one colour part from edge to edge, or that lie side
by side.

A shrunk copy loses strips of a few pixels, so that each row and column is looked at in full. JPEG
mixes thin strips with the pictures: what counts as an edge grows with what varies along the strip.
"""

from __future__ import annotations

from itertools import pairwise
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from physic_core.prepare.border import MOST_SAMPLES, largest_channel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import FloatArray, UInt8Array

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
_MOST_EQUAL = 3  # pictures of one size in a row
# Share of a line's length with a step to the next that is larger than the steps beside it: of 90
# photos at most .30 in the middle, of 90 pairs of photos at least .57.
_SEAM = 0.45
_SEAM_ANYWHERE = 0.6  # the same between pictures of two sizes; a railing has more
_PART_ANYWHERE = 0.2  # least side of such a picture, of the file's
_JPEG_PX = 8  # side of a block, whose edges are lines, too
_MORE_THAN_BLOCKS = 1.2


def count_pictures(image: UInt8Array) -> int:
    """Return the number of pictures between strips, or of one size, in an image (H, W, 3), rows
    times columns of them; 1 without a strip or a seam.
    """
    return len(_part_heights(image)) * len(_part_heights(image.transpose(1, 0, 2)))


def count_joined_pictures(image: UInt8Array) -> int:
    """Return the number of pictures of any sizes in an image (H, W, 3) that meet without a strip;
    the sides beside a picture count, too.
    """
    return len(_joined_heights(image)) * len(_joined_heights(image.transpose(1, 0, 2)))


def _part_heights(across: UInt8Array) -> list[int]:
    """Return the number of rows of each part of an image (H, W, 3) between strips along its
    rows.
    """
    height = len(across)
    ends = [0, *(end for strip in _strips(across) for end in strip), height]
    sides = [stop - start for start, stop in list(pairwise(ends))[::2]]
    if min(sides) < _PART * height:
        return [height]
    return sides if len(sides) > 1 else _equal_parts(across)


def _equal_parts(across: UInt8Array) -> list[int]:
    """Return the number of rows of each of the pictures of one size of which an image (H, W, 3)
    consists.
    """
    height = len(across)
    for count in range(2, _MOST_EQUAL + 1):
        seams = [height * one / count for one in range(1, count)]
        if all(_is_seam(across, int(seam)) or _is_seam(across, ceil(seam)) for seam in seams):
            return [height // count] * count
    return [height]


def _joined_heights(across: UInt8Array) -> list[int]:
    """Return the number of rows of each of the pictures that meet anywhere in an image
    (H, W, 3).
    """
    height = len(across)
    shares = _shares_of_seams(_samples(across))
    rows = (np.flatnonzero(shares > _SEAM_ANYWHERE) + 2).tolist()
    seams = [row for row in rows if _is_seam(across, row, _SEAM_ANYWHERE)]
    sides = [stop - start for start, stop in pairwise([0, *seams, height])]
    return sides if min(sides) >= _PART_ANYWHERE * height else [height]


def _samples(across: UInt8Array) -> NDArray[np.int16]:
    return across[:, :: max(1, across.shape[1] // MOST_SAMPLES)].astype(np.int16)


def _shares_of_seams(rows: NDArray[np.int16]) -> FloatArray:
    """Return for each of the rows (R, C, 3) from the third to the last but one in which share of
    the columns the step to it is larger than the steps beside.
    """
    steps = largest_channel(np.abs(np.diff(rows, axis=0)))
    beside = np.maximum(steps[:-2], steps[2:])
    shares: FloatArray = (steps[1:-1] > beside + _SAME).mean(1)
    return shares


def _is_seam(across: UInt8Array, row: int, least: float = _SEAM) -> bool:
    """Return whether two pictures meet before a row of an image (H, W, 3); one of a sky meets none:
    a horizon does that, too.
    """
    reach = 2 * _JPEG_PX + 2
    if not reach <= row <= len(across) - reach:
        return False
    rows = _samples(across[row - reach : row + reach])
    ends = rows[reach - 1 : reach + 1]
    color_difference = largest_channel(np.abs(ends - np.median(ends, axis=1, keepdims=True)))
    if np.percentile(color_difference, _PERCENTILE, axis=1).min() < _VARIES:
        return False
    shares = _shares_of_seams(rows)
    middle = reach - 2
    blocks = shares[middle % _JPEG_PX :: _JPEG_PX]
    others = np.delete(blocks, middle // _JPEG_PX)
    return bool(shares[middle] > max(least, _MORE_THAN_BLOCKS * others.max()))


def _strips(across: UInt8Array) -> list[tuple[int, int]]:
    """Return first row, and row after the last, of the strips along the rows of an image
    (H, W, 3).
    """
    samples = _samples(across)
    color: FloatArray = np.median(samples, axis=1).astype(np.float32)  # exact
    color_difference = largest_channel(np.abs(samples - color[:, None]))
    varies: FloatArray = np.percentile(color_difference, _PERCENTILE, axis=1)
    steps = largest_channel(np.abs(np.diff(color, axis=0))) > _SAME
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
        differing_shares = [
            (largest_channel(np.abs(rows - color[middle])) > step).any(0).mean()
            if len(rows)
            else 0.0
            for rows in sides
        ]
        if min(differing_shares) >= _SEEN and (color_difference[middle] > step).mean() <= _STRAY:
            strips.append((start, stop))
    return strips
