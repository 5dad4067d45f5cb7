"""Threshold of depth edges on a point map (paper Sec. 3.1 and 4.1)."""

from __future__ import annotations

import math

EDGE_RATIO = 1.05
"""Largest depth ratio within 3 x 3 pixels that is not a depth edge, for an image of 1024 px."""

_REFERENCE_SIDE = 1024


def edge_ratio(rows: int, columns: int) -> float:
    """Return the threshold of the depth ratio at an edge: ``EDGE_RATIO`` for an image side of 1024 px, otherwise
    scaled.

    The threshold is at most ``EDGE_RATIO`` squared, since edges are sharp in small images too.
    """
    power: float = min(2.0, _REFERENCE_SIDE / max(rows, columns, 1))
    return math.pow(EDGE_RATIO, power)
