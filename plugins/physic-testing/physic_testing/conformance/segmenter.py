"""Checks of a Segmenter: masks on the people, boxes round the masks, the floor under them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.metrics.matching import mask_iou
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckSkipped, expect

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray
    from physic_testing.conformance.subject import Subject

__all__ = ["CHECKS"]

LEAST_OVERLAP = 0.3
"""IoU with the true mask: conformance asks for the right pixels, the accuracy is reported beside it."""

LEAST_HELD, LEAST_BOX_OVERLAP = 0.95, 0.5


def check_masks_lie_on_people(subject: Subject) -> None:
    """The best mask of a photo of one person is on that person."""
    answer, truth = subject.answer(), subject.case("one person").truth
    expect(len(answer) > 0, "the person in a photo of one person to be found", "nobody (N = 0)")
    best = float(mask_iou(answer.masks, truth.masks).max())
    inverse = float(mask_iou(~answer.masks, truth.masks).max())
    expect(
        best >= LEAST_OVERLAP,
        f"a mask that overlaps the person by an IoU of at least {LEAST_OVERLAP}",
        f"{best:.2f}",
        f"The inverse overlaps by {inverse:.2f}: True is the person." if inverse > LEAST_OVERLAP else "",
    )


def check_boxes_hold_their_masks(subject: Subject) -> None:
    """Each box x0 y0 x1 y1 holds its mask, half open like a slice, and is not much larger."""
    answer = subject.answer()
    if not len(answer):
        raise CheckSkipped("nobody was found")
    for mask, box in zip(answer.masks, answer.boxes, strict=True):
        inside = np.zeros_like(mask)
        x0, y0, x1, y1 = (max(0, round(float(value))) for value in box)
        inside[y0:y1, x0:x1] = True
        held = float((mask & inside).sum() / mask.sum())
        tight = _tight(mask)
        expect(
            held >= LEAST_HELD,
            f"mask[y0:y1, x0:x1] to hold at least {LEAST_HELD:.0%} of the mask, whose own box is {tight} px",
            f"{held:.0%} in the box {np.round(box, 1).tolist()}",
            "Boxes are x0 y0 x1 y1 in px of the photo: not x y w h, not y x, not shares of the size.",
        )
        own = float(np.prod(np.subtract(tight[2:], tight[:2])))
        expect(
            own / max(float(inside.sum()), 1.0) >= LEAST_BOX_OVERLAP,
            f"a box about as large as its mask's own, {tight} px",
            f"{np.round(box, 1).tolist()}",
        )


def check_scores_are_sorted(subject: Subject) -> None:
    """People are sorted by score, the best first."""
    scores = subject.answer("several people").scores
    if len(scores) < 2:
        raise CheckSkipped("fewer than two people were found")
    expect(bool((np.diff(scores) <= 0).all()), "the best score first", f"{np.round(scores, 3).tolist()}")


def check_floor_is_under_the_people(subject: Subject) -> None:
    """The floor's mask, if there is one, lies mostly on the floor."""
    floor, truth = subject.answer().floor, subject.case("one person").truth
    if floor is None or not floor.any():
        raise CheckSkipped("it marks no floor")
    share = float(truth.empty_floor_mask[floor].mean())
    expect(
        share >= 0.5,
        "at least half of the floor's mask on the floor",
        f"{share:.0%}",
        "True is the floor." if float(truth.empty_floor_mask[~floor].mean()) > 0.5 else "",
    )


def check_floor_excludes_people(subject: Subject) -> None:
    """A pixel is a person's or the floor's, not both."""
    answer = subject.answer()
    if answer.floor is None or not answer.floor.any() or not len(answer):
        raise CheckSkipped("it marks no floor")
    share = float(answer.masks.any(axis=0)[answer.floor].mean())
    expect(share < 0.1, "a floor that leaves out the pixels of people", f"{share:.0%} of it lies on people")


def _tight(mask: BoolArray) -> list[int]:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    corners: FloatArray = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])
    return [int(value) for value in corners]


_READ = "physic_core.types.People"
CHECKS: tuple[Check, ...] = (
    Check(check_masks_lie_on_people, _READ),
    Check(check_boxes_hold_their_masks, _READ),
    Check(check_scores_are_sorted, _READ),
    Check(check_floor_is_under_the_people, _READ),
    Check(check_floor_excludes_people, _READ, after=("floor_is_under_the_people",)),
)
"""In the order in which they make sense."""
