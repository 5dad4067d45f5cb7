"""How outputs of a Segmenter are compared: masks, boxes, scores and the floor."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from physic_core.metrics import mask_iou
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.output_checks import PEOPLE_CHECKS
from physic_testing.conformance.readings import Group, Reading, Table, between, changed

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, People
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case
    from physic_testing.conformance.readings import Make, Values

MIN_IOU = 0.3
"""Minimum IoU with the true mask; it detects wrong pixels and does not judge the accuracy."""

MIN_ENCLOSED = 0.95
MIN_BOX_FILL = 0.5
"""Minimum share of a mask inside its box, and minimum area of the mask's own box as a share of the
box.
"""

MIN_SAME = 0.5
MIN_HELD = 0.8
"""Minimum IoU of a mask with the person that it shows, and share of a person whom a mask holds."""


def _values(answer: People, case: Case, truth: Values) -> Values:
    """Return masks matched to the true people (NaN if undetected), the floor, and how far boxes
    reach beyond their masks.
    """
    masks = np.full(truth["masks"].shape, np.nan)
    boxes = np.full((len(truth["masks"]), 4), np.nan)
    overlap = mask_iou(answer.masks, truth["masks"] > 0.5)
    for i in range(len(masks)) if len(answer) else ():
        best = int(overlap[:, i].argmax())
        if overlap[best, i] > MIN_SAME and answer.masks[best].any():
            masks[i] = answer.masks[best]
            boxes[i] = answer.boxes[best] - enclosing_box(answer.masks[best])
    floor = np.full(case.photo.shape[:2], np.nan) if answer.floor is None else answer.floor
    return {"masks": masks, "floor": np.where(case.hole, np.nan, floor), "boxes": boxes}


def _truth(answer: People, case: Case) -> Values:
    floor = np.where(case.hole, np.nan, case.truth.empty_floor_mask)
    masks = case.truth.masks.astype(np.float64)
    return {
        "masks": masks,
        "floor": floor,
        "boxes": np.zeros((len(masks), 4)),
    }


def _boxes(values: Values, truth: Values, case: Case) -> list[FloatArray]:
    return list(values["boxes"])


def _of(key: str) -> Callable[[Values, Values, Case], list[FloatArray]]:
    """Return the units of masks: blurred, so that a part of a pixel shows."""
    import cv2

    def units(values: Values, truth: Values, case: Case) -> list[FloatArray]:
        masks = values[key] if key == "masks" else [values[key]]
        found: list[FloatArray] = []
        for mask in masks:
            known = np.isfinite(mask)
            smooth = cv2.GaussianBlur(np.where(known, mask, 0).astype(np.float32), (0, 0), 1.0)
            found.append(np.where(known, smooth, np.nan).astype(np.float64).ravel())
        return found

    return units


def _moved(key: str, larger: float, right: float, down: float) -> Make:
    import cv2

    def warped(sign: int) -> Make:
        def make(masks: FloatArray) -> FloatArray:
            height, width = masks.shape[-2:]
            matrix = np.array(
                [[1.0 + sign * larger, 0, sign * right], [0, 1 + sign * larger, sign * down]],
                np.float64,
            )
            matrix[:, 2] -= sign * larger * (np.array([width, height]) - 1) / 2
            flat = np.nan_to_num(masks).astype(np.float32).reshape(-1, height, width)
            found = [cv2.warpAffine(mask, matrix, (width, height)) for mask in flat]
            return np.array(found, np.float64).reshape(masks.shape)

        return changed(**{key: make})

    return between(key, warped(1), warped(-1))


def _dilated(masks: FloatArray) -> FloatArray:
    import cv2

    return np.array(
        [cv2.dilate(m.astype(np.float32), np.ones((3, 3), np.uint8)) for m in masks], np.float64
    )


_PADDING = (
    "Is the padding of the network's input subtracted, and the mask resized by pixel centres?"
)
_TURNED = "Was the output for a mirrored or turned photo turned back?"
_DILATED = (
    "Are masks dilated, cut at a crop or another threshold, or is a part of the body of "
    "another class?"
)
_EXCLUSIVE = (
    "The last row and column are exclusive, and the box is that of the mask, not that of "
    "a detector."
)


def _readings(key: str, limit: float) -> tuple[Reading, ...]:
    return (
        Reading("mirrored", changed(**{key: lambda masks: masks[..., ::-1]}), _TURNED),
        Reading("upside down", changed(**{key: lambda masks: masks[..., ::-1, :]}), _TURNED),
        Reading("to the right", _moved(key, 0, 1, 0), _PADDING, 1.0, " px", limit),
        Reading("down", _moved(key, 0, 0, 1), _PADDING, 1.0, " px", limit),
        Reading(
            "larger about the photo's centre", _moved(key, 0.02, 0, 0), _PADDING, 2.0, " %", 0.75
        ),
    )


def _box_moved(edge: int) -> Make:
    return changed(boxes=lambda boxes: boxes + np.eye(4)[edge])


_OUTSIDE = between(
    "masks", changed(masks=_dilated), changed(masks=lambda masks: 1 - _dilated(1 - masks))
)
_SIZE = (Reading("farther out on all sides", _OUTSIDE, _DILATED, 1.0, " px", 2.5),)
_BOXES = tuple(
    Reading(f"too far right or down at the {edge}", _box_moved(i), _EXCLUSIVE, 1.0, " px", 0.5)
    for i, edge in enumerate(("left", "top", "right", "bottom"))
)
_LIE = ("masks_lie_on_people",)
_EXCLUDES = ("floor_mask_excludes_people",)
_ENCLOSE = ("boxes_enclose_their_masks",)
_MASKS = (*_readings("masks", 0.5), *_SIZE)
TABLE = Table(
    _values,
    _truth,
    (
        Group(
            "masks_are_in_place",
            "masks of people in place",
            "of a mask",
            _of("masks"),
            _MASKS,
            after=_LIE,
        ),
        Group(
            "floor_is_in_place",
            "the floor in place",
            "of a mask",
            _of("floor"),
            _readings("floor", 0.3),
            after=_EXCLUDES,
        ),
        Group(
            "boxes_are_tight", "boxes of masks, end exclusive", "px", _boxes, _BOXES, after=_ENCLOSE
        ),
    ),
    "physic_core.types.People",
)


def check_masks_lie_on_people(subject: BackendUnderTest) -> None:
    """The best mask overlaps one person, and people side by side have masks of their own."""
    answer = subject.result()
    truth = subject.case("one person").truth
    expect(len(answer) > 0, "one person, as in the photo", "N = 0")
    best = float(mask_iou(answer.masks, truth.masks).max())
    inverted = float(mask_iou(~answer.masks, truth.masks).max())
    expect(
        best >= MIN_IOU,
        f"a mask with an IoU of at least {MIN_IOU} with the true mask",
        f"{best:.2f}, and {inverted:.2f} if it is inverted",
        "True marks the person. Is the output turned, resized and moved back to the photo?",
    )
    answer = subject.result("several people")
    truth = subject.case("several people").truth
    held = (answer.masks[:, None] & truth.masks).sum((2, 3)) / truth.masks.sum((1, 2))
    expect(
        not (held > MIN_HELD).all(axis=1).any(),
        f"one mask for each of {len(truth.masks)} people",
        "a mask that holds all of them",
        "Is it a semantic class? Masks are those of instances.",
    )
    expect(
        bool((np.diff(answer.scores) <= 0).all()),
        "people sorted by score, in descending order",
        f"{np.round(answer.scores, 3).tolist()}",
    )


def check_boxes_enclose_their_masks(subject: BackendUnderTest) -> None:
    """Each box is x0 y0 x1 y1 in px, end exclusive, and encloses its mask."""
    people = [
        (mask, box)
        for _, a in subject.evidence()
        for mask, box in zip(a.masks, a.boxes, strict=True)
    ]
    if not people:
        raise CheckSkipped("no people were found")
    for mask, box in people:
        own = enclosing_box(mask)
        inside = np.zeros_like(mask)
        x0, y0, x1, y1 = (max(0, round(float(value))) for value in box)
        inside[y0:y1, x0:x1] = True
        held = float((mask & inside).sum() / mask.sum())
        filled = np.prod(own[2:] - own[:2]) / max(inside.sum(), 1)
        expect(
            held >= MIN_ENCLOSED and filled >= MIN_BOX_FILL,
            f"mask[y0:y1, x0:x1] to contain the mask, whose tight box is {own.tolist()} px",
            f"{held:.0%} of it in the box {np.round(box, 1).tolist()}",
            "Boxes are x0 y0 x1 y1 in px of the photo, of the mask of the same row: not x y w h, "
            "y x order or shares.",
        )


def check_floor_mask_excludes_people(subject: BackendUnderTest) -> None:
    """At least half of the floor mask lies on the true floor, and none of it on people."""
    answer = subject.result()
    truth = subject.case("one person").truth
    floor = answer.floor
    if floor is None or not floor.any():
        raise CheckSkipped("it returns no floor mask")
    share = float(truth.empty_floor_mask[floor].mean())
    hint = "True marks the floor. Is it another class, or upside down?"
    expect(share >= 0.5, "at least half of the floor mask on the true floor", f"{share:.0%}", hint)
    held = float(answer.masks.any(axis=0)[floor].mean()) if len(answer) else 0.0
    expect(
        held < 0.1, "a floor mask without the pixels of people", f"{held:.0%} of it lies on people"
    )


def enclosing_box(mask: BoolArray) -> FloatArray:
    """Return the tight box x0 y0 x1 y1 of a mask."""
    rows = np.flatnonzero(mask.any(axis=1))
    columns = np.flatnonzero(mask.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])


_READ = TABLE.read
CHECKS: tuple[Check, ...] = (
    *PEOPLE_CHECKS,
    Check(check_masks_lie_on_people, _READ),
    Check(check_boxes_enclose_their_masks, _READ),
    Check(check_floor_mask_excludes_people, _READ),
)
"""Further checks of a Segmenter, in order of execution."""
