"""Ask about people who may not be in the room: a frame is around them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np

from physic_core.backends.people import boxes_from_masks
from physic_core.types import select_people

if TYPE_CHECKING:
    from collections.abc import Iterator

    from physic_core.types import BoolArray, People

_RIM = 0.08  # width of the band, over the longer side of the person's box
# Of five people in pictures pasted on the wall of a room 1, 1, 1, .87 and .17 of the band; of 17
# people in seven photos at most .01.
_SHARE = 0.5
_IN_ROOM = 0.5  # probability that a person who is asked about is in the room; assumed, not fitted


def halve_unlikely_people(people: People, framed: BoolArray) -> People:
    """Return people, sorted by score, with the score of those halved who may not be in the room,
    and with a note about them.

    Args:
        people: with keypoints and labels of surfaces.
        framed: (H, W) bool, pixels of paintings and mirrors.
    """
    pictures = np.array(
        [band.any() and framed[band].mean() > _SHARE for band in _bands_around(people.masks)], bool
    )
    scores = np.where(pictures, _IN_ROOM, 1) * people.scores
    asked = replace(
        people,
        scores=scores.astype(people.scores.dtype),
        notes=people.notes + ((_unlikely_people_note(people, pictures),) if pictures.any() else ()),
    )
    return select_people(asked, np.argsort(-scores, kind="stable"))


def _unlikely_people_note(people: People, asked: BoolArray) -> str:
    """Return a note about the people (N,) who are ``asked`` about."""
    boxes = boxes_from_masks(people.masks[asked]).round().astype(int).tolist()
    places = " and ".join(",".join(map(str, box)) for box in boxes)
    return (
        f"the person in the box {places} px is in a frame or a mirror: a picture, a screen, a "
        f"reflection? If so, leave it out by --ignore x,y. If not, give --person x,y for each "
        f"person to keep; until then this size has half the weight"
    )


def _bands_around(people: BoolArray) -> Iterator[BoolArray]:
    """Yield the band (H, W) around each of the people (N, H, W), without anybody's pixels."""
    anybody = people.any(0)
    for mask, (x0, y0, x1, y1) in zip(people, boxes_from_masks(people).tolist(), strict=True):
        side = 1 + 2 * max(1, round(_RIM * max(x1 - x0, y1 - y0)))
        band = cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
        yield band & ~anybody
