"""Overlapping square tiles that cover an image."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

_SMALLEST_PX = 160  # side of a tile


def tiles(width: int, height: int, fractions: Sequence[float]) -> Iterator[tuple[int, int, int]]:
    """Yield overlapping squares (x, y, side) that cover an image, in px.

    Args:
        width: of the image, px.
        height: of the image, px.
        fractions: sides of the tiles over the image's long side; 1 and above give no tile.
    """
    for fraction in fractions:
        # Rounded down, a long side of 1279 px would need a fifth tile of .4 where 1280 px need
        # four.
        side = math.ceil(fraction * max(width, height))
        if side < _SMALLEST_PX or fraction >= 1.0:
            continue

        def starts(length: int, side: int = side) -> list[int]:
            if length <= side:
                return [0]
            count = int(np.ceil((length - side) / (side / 2))) + 1
            return [int(v) for v in np.linspace(0, length - side, count)]

        for y in starts(height):
            for x in starts(width):
                yield x, y, side
