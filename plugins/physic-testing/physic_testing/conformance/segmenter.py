"""Checks of a Segmenter: person masks, boxes, scores and floor mask."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.metrics.matching import mask_iou
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckSkipped, expect

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest

__all__ = ["CHECKS"]

MIN_IOU = 0.3
"""Minimum IoU with the true mask; it detects wrong pixels and does not judge the accuracy."""

MIN_ENCLOSED, MIN_BOX_FILL = 0.95, 0.5
"""Minimum share of a mask inside its box, and minimum area of the mask's own box as a share of the box."""


def check_masks_lie_on_people(subject: BackendUnderTest) -> None:
    """In a photo of one person, the best mask overlaps that person."""
    answer, truth = subject.result(), subject.case("one person").truth
    expect(len(answer) > 0, "one person, as in the photo", "N = 0")
    best = float(mask_iou(answer.masks, truth.masks).max())
    inverse = float(mask_iou(~answer.masks, truth.masks).max())
    expect(
        best >= MIN_IOU,
        f"a mask with an IoU of at least {MIN_IOU} with the true mask",
        f"{best:.2f}",
        f"The inverted mask has an IoU of {inverse:.2f}: True marks the person." if inverse > MIN_IOU else "",
    )


def check_boxes_enclose_their_masks(subject: BackendUnderTest) -> None:
    """Each box is x0 y0 x1 y1 in px, end exclusive, and encloses its mask tightly."""
    answer = subject.result()
    if not len(answer):
        raise CheckSkipped("no people were found")
    for mask, box in zip(answer.masks, answer.boxes, strict=True):
        inside = np.zeros_like(mask)
        x0, y0, x1, y1 = (max(0, round(float(value))) for value in box)
        inside[y0:y1, x0:x1] = True
        held = float((mask & inside).sum() / mask.sum())
        tight = _enclosing_box(mask)
        expect(
            held >= MIN_ENCLOSED,
            f"mask[y0:y1, x0:x1] to contain at least {MIN_ENCLOSED:.0%} of the mask, whose tight box is {tight} px",
            f"{held:.0%} in the box {np.round(box, 1).tolist()}",
            "Boxes are x0 y0 x1 y1 in px of the photo: not x y w h, y x order or shares of the size.",
        )
        own = float(np.prod(np.subtract(tight[2:], tight[:2])))
        expect(
            own / max(float(inside.sum()), 1.0) >= MIN_BOX_FILL,
            f"a box about as large as the tight box, {tight} px",
            f"{np.round(box, 1).tolist()}",
        )


def check_scores_are_sorted(subject: BackendUnderTest) -> None:
    """People are sorted by score in descending order."""
    scores = subject.result("several people").scores
    if len(scores) < 2:
        raise CheckSkipped("fewer than two people were found")
    expect(bool((np.diff(scores) <= 0).all()), "scores in descending order", f"{np.round(scores, 3).tolist()}")


def check_floor_mask_is_on_the_floor(subject: BackendUnderTest) -> None:
    """At least half of the floor mask lies on the true floor."""
    floor, truth = subject.result().floor, subject.case("one person").truth
    if floor is None or not floor.any():
        raise CheckSkipped("it returns no floor mask")
    share = float(truth.empty_floor_mask[floor].mean())
    expect(
        share >= 0.5,
        "at least half of the floor mask on the true floor",
        f"{share:.0%}",
        "True marks the floor." if float(truth.empty_floor_mask[~floor].mean()) > 0.5 else "",
    )


def check_floor_mask_excludes_people(subject: BackendUnderTest) -> None:
    """The floor mask and the person masks do not overlap."""
    answer = subject.result()
    if answer.floor is None or not answer.floor.any() or not len(answer):
        raise CheckSkipped("it returns no floor mask")
    share = float(answer.masks.any(axis=0)[answer.floor].mean())
    expect(share < 0.1, "a floor mask without the pixels of people", f"{share:.0%} of it lies on people")


def _enclosing_box(mask: BoolArray) -> list[int]:
    """Return the tight box x0 y0 x1 y1 of a mask."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    corners: FloatArray = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])
    return [int(value) for value in corners]


_READ = "physic_core.types.People"
CHECKS: tuple[Check, ...] = (
    Check(check_masks_lie_on_people, _READ),
    Check(check_boxes_enclose_their_masks, _READ),
    Check(check_scores_are_sorted, _READ),
    Check(check_floor_mask_is_on_the_floor, _READ),
    Check(check_floor_mask_excludes_people, _READ, after=("floor_mask_is_on_the_floor",)),
)
"""Checks of a Segmenter, in order of execution."""
