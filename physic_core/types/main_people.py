"""Who counts for the grade of a photo."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physic_core.types.arrays import FloatArray

_MAIN_SHARE = 0.5


def main_people(boxes: Sequence[FloatArray] | FloatArray) -> tuple[int, ...]:
    """Return the indices of the main people: those at least half as large in the photo as the largest one.

    The size is the longer side of the box: people who lie are as large as people who stand.

    Args:
        boxes: (4,) each, x0 y0 x1 y1, px.
    """
    sizes = [max(float(x1 - x0), float(y1 - y0)) for x0, y0, x1, y1 in boxes]
    return tuple(i for i, size in enumerate(sizes) if size >= _MAIN_SHARE * max(sizes))
