"""Name people who may be pictures, on screens or reflections: a frame is around them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from physic_core.adapters.people import boxes_from_masks

if TYPE_CHECKING:
    from physic_core.types import BoolArray

_RIM = 0.08  # width of the rim, over the longer side of the person's box
# Of five people in pictures pasted on the wall of a room 1, 1, 1, .87 and .17 of the rim; of 17
# people in seven photos at most .01.
_SHARE = 0.5


def framed_note(people: BoolArray, framed: BoolArray) -> tuple[str, ...]:
    """Return a note about those people (N, H, W) around whom a painting or a mirror (H, W) is."""
    anybody = people.any(0)
    places = []
    for mask, edges in zip(people, boxes_from_masks(people), strict=True):
        x0, y0, x1, y1 = edges.round().astype(int).tolist()
        side = 1 + 2 * max(1, round(_RIM * max(x1 - x0, y1 - y0)))
        rim = cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
        rim &= ~anybody
        if rim.any() and framed[rim].mean() > _SHARE:
            places.append(f"({x0}, {y0}, {x1}, {y1})")
    if not places:
        return ()
    return (
        f"who is in {' and '.join(places)} may be a picture, on a screen or a reflection, since a "
        f"frame or mirror is around them: --ignore x,y leaves them out",
    )
