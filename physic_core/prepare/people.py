"""People whom the user chose or knows: select them, and assign statures and ages."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.backends.people import box_iou, boxes_from_masks
from physic_core.errors import ConfigError, NoPersonError
from physic_core.types import NOT_CHOSEN, UnposedPerson
from physic_core.types.arrays import select_people
from physic_core.types.known_sizes import KnownPeople

if TYPE_CHECKING:
    from physic_core.types import (
        BoolArray,
        FloatArray,
        IntArray,
        KnownSizes,
        People,
        PeoplePrompt,
    )

LEAST_OVERLAP = 0.3
"""Least overlap of a detected person with the box or the body that the user gives."""
_MIN_MASK_IOU = 0.5
"""Minimum overlap of a given mask with a detected one to keep the detected keypoints."""


def order_left_to_right(people: People) -> IntArray:
    """Return the rows (N,) of people from left to right in the photo, by the centres of their
    boxes.
    """
    boxes = np.asarray(people.boxes, np.float64).reshape(-1, 4)
    return np.argsort(boxes[:, 0] + boxes[:, 2], kind="stable")


def known_people(known: KnownSizes, count: int) -> KnownPeople:
    """Return the known stature, metres, and age, years, of each of N people, NaN where unknown.

    Args:
        known: its statures and ages are in the order of the people.
        count: N.

    Raises:
        ConfigError: there are several statures or ages, but not one per person.
    """
    years = _values_per_person(known.age, "age", count)
    return KnownPeople(years, _values_per_person(known.stature, "stature", count))


def expand_known(known: KnownPeople, rows: BoolArray) -> KnownPeople:
    """Return what is known of more people (N,): NaN of those who are not in ``rows``."""
    years, stature = (
        None if each is None else np.concatenate([each, np.full((~rows).sum(), np.nan)])
        for each in (known.years, known.stature)
    )
    return KnownPeople(years, stature)


def with_given_masks(people: People, masks: BoolArray) -> tuple[People, int]:
    """Return people with the mask of (M, H, W) that covers each best, where one does, and how many
    have one.
    """
    rows = [_best_match(mask, masks) for mask in people.masks]
    own = np.array(people.masks)
    for person, row in enumerate(rows):
        if row is not None:
            others = np.delete(own, person, 0).any(0)
            own[person] = masks[row] & ~others
    boxes = boxes_from_masks(own).astype(np.float32)
    return replace(people, masks=own, boxes=boxes), sum(row is not None for row in rows)


def with_people_of_masks(people: People, masks: BoolArray) -> People:
    """Return the people and others of given masks (M, H, W), whose keypoints are to be found."""
    every = np.concatenate([people.masks, masks])
    return replace(
        people,
        masks=every,
        boxes=boxes_from_masks(every).astype(np.float32),
        scores=np.concatenate([people.scores, np.ones(len(masks), people.scores.dtype)]),
        floor=None if people.floor is None else people.floor & ~masks.any(0),
        keypoints=None,
        heads=None,
    )


def _values_per_person(given: tuple[float, ...], name: str, count: int) -> FloatArray | None:
    if not any(given):
        return None
    if len(given) > 1 and len(given) != count:
        raise ConfigError(
            f"{len(given)} {name}s were given, but {count} "
            f"{'person was' if count == 1 else 'people were'} found: give "
            f"one {name} for all, or one per person from left to right with 0 where it is unknown"
        )
    values = np.array(given * count if len(given) == 1 else given, np.float64)
    return np.where(values > 0, values, np.nan)


def select_chosen(people: People, prompt: PeoplePrompt) -> People:
    """Return the people whom the prompts hit, in the order of the prompts, with the given masks
    unchanged.

    Args:
        people: all people whom the segmenter found, (N, H, W) masks.
        prompt: in px of the same image.

    Raises:
        NoPersonError: no person is at a point or box, or two prompts select the same person.
    """
    rows = _rows_of_prompt(people, prompt)
    for i, row in enumerate(rows):
        if row in rows[:i]:
            first = prompt.describe(rows.index(row))
            second = prompt.describe(i)
            raise NoPersonError(
                f"{first} and {second} hit the same person: give one prompt for each person, or a "
                "box or mask where people overlap"
            )
    given_masks = people.masks[:0] if prompt.masks is None else prompt.masks
    masks = np.concatenate([people.masks[rows] & ~given_masks.any(0), given_masks])
    # The user is sure of a mask.
    scores = np.concatenate([people.scores[rows], np.ones(len(given_masks), people.scores.dtype)])
    matches = [_best_match(mask, people.masks) for mask in given_masks]
    keypoints = people.keypoints
    if None in matches:
        keypoints = None  # the keypoint detector finds those of all people
    if keypoints is not None:
        keypoints = select_people(keypoints, np.array([*rows, *matches], int))
    hidden = np.flatnonzero(~masks.any((1, 2)))
    if len(hidden):
        raise NoPersonError(
            f"the given masks hide all of {prompt.describe(int(hidden[0]))}: omit it"
        )
    floor = None if people.floor is None else people.floor & ~masks.any(0)
    boxes = boxes_from_masks(masks).astype(np.float32)
    others = ~np.isin(np.arange(len(people)), [row for row in (*rows, *matches) if row is not None])
    return replace(
        people,
        masks=masks,
        boxes=boxes,
        scores=scores,
        floor=floor,
        keypoints=keypoints,
        heads=None,
        unposed=people.unposed + without_bodies(people, others, NOT_CHOSEN),
    )


def without_bodies(people: People, rows: BoolArray, reason: str) -> tuple[UnposedPerson, ...]:
    """Return some (N,) bool of the people as people without a body, for one reason."""
    boxes, scores = people.boxes[rows].tolist(), people.scores[rows].tolist()
    return tuple(
        UnposedPerson((x0, y0, x1, y1), score, reason)
        for (x0, y0, x1, y1), score in zip(boxes, scores, strict=True)
    )


def is_ignored_person(people: People, prompt: PeoplePrompt) -> BoolArray:
    """Return which people (N,) bool the user leaves out.

    Raises:
        NoPersonError: no person is at a point, box or mask.
    """
    rows = _rows_of_prompt(people, prompt, prompt.masks)
    return np.isin(np.arange(len(people)), rows)


def _rows_of_prompt(
    people: People, prompt: PeoplePrompt, masks: BoolArray | None = None
) -> list[int]:
    """Return the rows of the people at the points, boxes and masks (M, H, W) of a prompt."""
    rows_found = [person_at_point(people, point) for point in prompt.points]
    rows_found += [person_in_box(people, box) for box in prompt.boxes]
    rows_found += [_best_match(mask, people.masks) for mask in (() if masks is None else masks)]
    rows = []
    for index, row in enumerate(rows_found):
        if row is None:
            height, width = people.masks.shape[1:]
            boxes = ", ".join(str(tuple(np.round(b).astype(int).tolist())) for b in people.boxes)
            others = f"people were found in the boxes {boxes}" if boxes else "no person was found"
            raise NoPersonError(
                f"no person was found at {prompt.describe(index)}, in px of the photo at {width} x "
                f"{height} px; {others}: choose one of them, mark the person with a mask, or use a "
                "segmenter that takes prompts"
            )
        rows.append(row)
    return rows


def person_at_point(people: People, point: tuple[float, float]) -> int | None:
    """Return the person whose mask contains a pixel x, y; otherwise the one with the smallest box
    around it, or None.
    """
    x, y = point
    on_mask = np.flatnonzero(people.masks[:, round(y), round(x)])
    if len(on_mask):
        return int(on_mask[0])
    x0, y0, x1, y1 = people.boxes.T
    inside = np.flatnonzero((x0 - 0.5 <= x) & (x < x1 - 0.5) & (y0 - 0.5 <= y) & (y < y1 - 0.5))
    area = (x1 - x0) * (y1 - y0)
    return int(inside[area[inside].argmin()]) if len(inside) else None


def person_in_box(people: People, box: tuple[float, float, float, float]) -> int | None:
    """Return the person whose box has the largest intersection over union with a box; None below
    ``LEAST_OVERLAP``.
    """
    if not len(people):
        return None
    overlap = box_iou(np.array([box]), np.asarray(people.boxes, np.float64))[0]
    best = int(overlap.argmax())
    return best if overlap[best] >= LEAST_OVERLAP else None


def _best_match(mask: BoolArray, masks: BoolArray) -> int | None:
    """Return the row of the mask with the largest intersection over union; None below
    ``_MIN_MASK_IOU``.
    """
    if not len(masks):
        return None
    overlap: FloatArray = (masks & mask).sum((1, 2)) / (masks | mask).sum((1, 2))
    best = int(overlap.argmax())
    return best if overlap[best] >= _MIN_MASK_IOU else None
