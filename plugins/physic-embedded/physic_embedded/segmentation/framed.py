"""Name people who may not be in the room: a frame is around them, or they stand on a table."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from physic_core.adapters.people import boxes_from_masks
from physic_core.types import skeleton_named

if TYPE_CHECKING:
    from collections.abc import Iterator

    from physic_core.types import BoolArray, People

_RIM = 0.08  # width of the rim, over the longer side of the person's box
# Of five people in pictures pasted on the wall of a room 1, 1, 1, .87 and .17 of the rim; of 17
# people in seven photos at most .01.
_SHARE = 0.5
_FEET = 0.1  # of the height of the box, lowest part
_SMALL = 0.75  # of the height of the largest box in the photo; the label errs on bare ground
_SEEN = 0.5  # confidence of an ankle: those of people who sit behind a table have less


def framed_note(people: BoolArray, framed: BoolArray) -> tuple[str, ...]:
    """Return a note about those people (N, H, W) around whom a painting or a mirror (H, W) is."""
    places = [
        place
        for place, rim in zip(_places(people), _rims(people), strict=True)
        if rim.any() and framed[rim].mean() > _SHARE
    ]
    if not places:
        return ()
    return (
        f"who is in {' and '.join(places)} may be a picture, on a screen or a reflection, since a "
        f"frame or mirror is around them: --ignore x,y leaves them out",
    )


def figurine_note(people: People) -> tuple[str, ...]:
    """Return a note about those people who stand on a table, small beside others or alone."""
    if people.surfaces is None or people.keypoints is None:
        return ()
    names = skeleton_named(people.keypoints.skeleton).names
    ankles = [names.index(f"{side}_ankle") for side in ("left", "right")]
    seen = people.keypoints.confidence[:, ankles].max(1, initial=0.0) > _SEEN
    heights = people.boxes[:, 3] - people.boxes[:, 1]
    small = (heights < _SMALL * heights.max(initial=0.0)) | (len(people) == 1)
    table = people.surfaces.mask("table")
    rows = np.arange(table.shape[0])[:, None]
    places = []
    for i, (place, rim) in enumerate(zip(_places(people.masks), _rims(people.masks), strict=True)):
        top, bottom = people.boxes[i, [1, 3]]
        rim = rim & (rows > bottom - _FEET * (bottom - top))
        if seen[i] and small[i] and rim.any() and table[rim].mean() > _SHARE:
            places.append(place)
    if not places:
        return ()
    return (
        f"who is in {' and '.join(places)} stands on a table: a figurine? --ignore x,y leaves it "
        f"out, and its size is then no evidence for that of the rest",
    )


def _places(people: BoolArray) -> list[str]:
    """Return the boxes of people (N, H, W) as text."""
    return [
        "({}, {}, {}, {})".format(*edges.round().astype(int)) for edges in boxes_from_masks(people)
    ]


def _rims(people: BoolArray) -> Iterator[BoolArray]:
    """Yield the rim (H, W) around each of the people (N, H, W), without anybody's pixels."""
    anybody = people.any(0)
    for mask, (x0, y0, x1, y1) in zip(people, boxes_from_masks(people).tolist(), strict=True):
        side = 1 + 2 * max(1, round(_RIM * max(x1 - x0, y1 - y0)))
        rim = cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
        yield rim & ~anybody
