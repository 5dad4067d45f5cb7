"""Ask about people who may not be in the room: a frame is around them, or they stand on a table."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np

from physic_core.backends.people import boxes_from_masks
from physic_core.types import SURE_CONFIDENCE, select_people, skeleton_named

if TYPE_CHECKING:
    from collections.abc import Iterator

    from physic_core.types import BoolArray, People

_RIM = 0.08  # width of the band, over the longer side of the person's box
# Of five people in pictures pasted on the wall of a room 1, 1, 1, .87 and .17 of the band; of 17
# people in seven photos at most .01.
_SHARE = 0.5
_FEET = 0.1  # of the height of the box, lowest part
_SMALL = 0.75  # of the height of the largest box in the photo; the label errs on ground and mats
_IN_ROOM = 0.5  # probability that a person who is asked about is in the room; assumed, not fitted


def halve_unlikely_people(people: People, framed: BoolArray) -> People:
    """Return people, sorted by score, with the score of those halved who may not be in the room,
    and with a note about them.

    Args:
        people: with keypoints and labels of surfaces.
        framed: (H, W) bool, pixels of paintings and mirrors.
    """
    bands = list(_bands_around(people.masks))
    pictures = np.array([band.any() and framed[band].mean() > _SHARE for band in bands], bool)
    figurines = _on_tables(people, bands)
    notes = (
        _note(people, pictures, "is in a frame or a mirror: a picture, a screen, a reflection?"),
        _note(people, figurines, "stands on a table: a figurine?"),
    )
    scores = np.where(pictures | figurines, _IN_ROOM, 1) * people.scores
    is_unlikely = replace(
        people,
        scores=scores.astype(people.scores.dtype),
        notes=people.notes + tuple(filter(None, notes)),
    )
    return select_people(is_unlikely, np.argsort(-scores, kind="stable"))


def _on_tables(people: People, bands: list[BoolArray]) -> BoolArray:
    """Return which people (N,) stand on a table, and are small beside others."""
    found = np.zeros(len(people), bool)
    if people.surfaces is None or people.keypoints is None:
        return found
    names = skeleton_named(people.keypoints.skeleton).names
    ankles = [names.index(f"{side}_ankle") for side in ("left", "right")]
    seen = people.keypoints.confidence[:, ankles].max(1, initial=0.0) > SURE_CONFIDENCE
    heights = people.boxes[:, 3] - people.boxes[:, 1]
    small = heights < _SMALL * heights.max(initial=0.0)
    table = people.surfaces.mask("table")
    rows = np.arange(table.shape[0])[:, None]
    for i, band in enumerate(bands):
        top, bottom = people.boxes[i, [1, 3]]
        below = band & (rows > bottom - _FEET * (bottom - top))
        found[i] = seen[i] and small[i] and below.any() and table[below].mean() > _SHARE
    return found


def _note(people: People, is_unlikely: BoolArray, why: str) -> str:
    """Return a note about the people (N,) who are ``is_unlikely`` about, or ""."""
    if not is_unlikely.any():
        return ""
    boxes = boxes_from_masks(people.masks[is_unlikely]).round().astype(int).tolist()
    places = " and ".join(",".join(map(str, box)) for box in boxes)
    return (
        f"the person in the box {places} px {why} If so, leave it out by --ignore x,y. If not, "
        f"give --person x,y for each person to keep; until then this size has half the weight"
    )


def _bands_around(people: BoolArray) -> Iterator[BoolArray]:
    """Yield the band (H, W) around each of the people (N, H, W), without anybody's pixels."""
    anybody = people.any(0)
    for mask, (x0, y0, x1, y1) in zip(people, boxes_from_masks(people).tolist(), strict=True):
        side = 1 + 2 * max(1, round(_RIM * max(x1 - x0, y1 - y0)))
        band = cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
        yield band & ~anybody
