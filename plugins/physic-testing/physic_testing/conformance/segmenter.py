"""Checks of a Segmenter: person masks, boxes, scores and floor mask."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from physic_core.metrics import mask_iou
from physic_testing.conformance.bias import MIN_UNITS, expect_no_better, expect_no_bias, pixel_shift
from physic_testing.conformance.check import Check
from physic_testing.conformance.exactness import SIDES, outward_px
from physic_testing.conformance.expect import CheckSkipped, expect

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest

MIN_IOU = 0.3
"""Minimum IoU with the true mask; it detects wrong pixels and does not judge the accuracy."""

MIN_ENCLOSED, MIN_BOX_FILL = 0.95, 0.5
"""Minimum share of a mask inside its box, and minimum area of the mask's own box as a share of the box."""

MIN_SAME, MIN_HELD = 0.5, 0.8
"""Minimum IoU of a mask with the person that it shows, and share of a person whom a mask holds."""

_READINGS: dict[str, Callable[[BoolArray], BoolArray]] = {
    "mirrored": lambda masks: masks[:, :, ::-1],
    "upside down": lambda masks: masks[:, ::-1],
}

MAX_SHIFT_PX, MAX_REACH_PX = 0.5, 5.0
"""Mean shift of masks, and mean excess of masks and boxes on each side, that are treated as zero."""


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


def check_people_have_masks_of_their_own(subject: BackendUnderTest) -> None:
    """People who stand side by side are several people, not one mask of the class "person"."""
    answer, truth = subject.result("several people"), subject.case("several people").truth
    held = (answer.masks[:, None] & truth.masks).sum((2, 3)) / truth.masks.sum((1, 2))
    expect(
        not (held > MIN_HELD).all(axis=1).any(),
        f"one mask for each of {len(truth.masks)} people",
        "a mask that holds all of them",
        "Is it a semantic class? Masks are those of instances.",
    )


def check_boxes_enclose_their_masks(subject: BackendUnderTest) -> None:
    """Each box is x0 y0 x1 y1 in px, end exclusive, and encloses its mask tightly."""
    people = [(mask, box) for _, a in subject.evidence() for mask, box in zip(a.masks, a.boxes, strict=True)]
    if not people:
        raise CheckSkipped("no people were found")
    tight = np.array([_enclosing_box(mask) for mask, _ in people])
    for (mask, box), own in zip(people, tight, strict=True):
        inside = np.zeros_like(mask)
        x0, y0, x1, y1 = (max(0, round(float(value))) for value in box)
        inside[y0:y1, x0:x1] = True
        held = float((mask & inside).sum() / mask.sum())
        expect(
            held >= MIN_ENCLOSED,
            f"mask[y0:y1, x0:x1] to contain at least {MIN_ENCLOSED:.0%} of the mask, whose tight box is {own} px",
            f"{held:.0%} in the box {np.round(box, 1).tolist()}",
            "Boxes are x0 y0 x1 y1 in px of the photo, of the mask of the same row: not x y w h, y x order or shares.",
        )
        expect(
            float(np.prod(own[2:] - own[:2])) / max(float(inside.sum()), 1.0) >= MIN_BOX_FILL,
            f"a box about as large as the tight box, {own} px",
            f"{np.round(box, 1).tolist()}",
        )
    lost = (np.array([box for _, box in people]) - tight) * [1, 1, -1, -1]
    for edge, values in zip(("left", "top", "right", "bottom"), lost.T, strict=True):
        expect_no_bias(
            np.maximum(values, 0),
            MAX_SHIFT_PX,
            f"boxes whose {edge} edge does not cut their masks",
            " px cut off",
            "The last row and column are exclusive: x1 is the last column of the mask + 1.",
        )
        expect_no_bias(
            np.maximum(-values, 0),
            MAX_REACH_PX,
            f"boxes whose {edge} edge is that of their masks",
            " px too far out",
            "The last row and column are exclusive, and the box is that of the mask, not that of a detector.",
        )


def check_masks_are_not_shifted(subject: BackendUnderTest) -> None:
    """Masks are not mirrored, and the mean shift of those of people, and of the floor, is below half a pixel."""
    people, floors = [], []
    own: list[float] = []
    others: dict[str, list[float]] = {name: [] for name in _READINGS}
    for case, answer in subject.evidence():
        for errors, masks in ((own, answer.masks), *((others[n], r(answer.masks)) for n, r in _READINGS.items())):
            errors += list(1 - mask_iou(masks, case.truth.masks).max(axis=0, initial=0.0))
        everywhere = np.ones(case.photo.shape[:2], bool)
        overlap = mask_iou(answer.masks, case.truth.masks)
        for i, true in enumerate(case.truth.masks):
            if len(answer) and overlap[:, i].max() > MIN_SAME:
                people.append(_shift(answer.masks[int(overlap[:, i].argmax())], true, everywhere))
        if answer.floor is not None:
            floors.append(_shift(answer.floor, case.truth.empty_floor_mask, ~case.hole))
    readings = {name: np.array(errors) for name, errors in others.items()}
    expect_no_better(np.array(own), readings, 0.01, "masks in the rows and columns of the photo, mean 1 - IoU")
    for what, found in (("masks of people", people), ("masks of the floor", floors)):
        if len(found) >= MIN_UNITS:
            for axis, way in enumerate("xy"):
                expect_no_bias(
                    np.array(found)[:, axis],
                    MAX_SHIFT_PX,
                    f"{what} in place along {way}",
                    " px",
                    "Is the padding of the network's input subtracted, and the mask resized to the photo's size?",
                )


def check_masks_are_as_large_as_people(subject: BackendUnderTest) -> None:
    """Over several photos, masks reach as far as people to the left, up, right and down."""
    reach = [
        outward_px(answer, case)[(mask_iou(answer.masks, case.truth.masks) > MIN_SAME).any(axis=0)]
        for case, answer in subject.evidence()
        if len(answer)
    ]
    for side, values in zip(SIDES, np.concatenate(reach or [np.zeros((0, 4))]).T, strict=True):
        expect_no_bias(
            values,
            MAX_REACH_PX,
            f"masks that reach as far as people, {side}",
            " px farther",
            "Are masks dilated, cut at a crop, or is a part of the body of another class?",
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


def _shift(mask: BoolArray, true: BoolArray, known: BoolArray) -> FloatArray:
    """Return the shift (2,) of a mask against the true one, px."""
    return pixel_shift(mask.astype(float), true.astype(float), known, edges=False)


def _enclosing_box(mask: BoolArray) -> list[int]:
    """Return the tight box x0 y0 x1 y1 of a mask."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    corners: FloatArray = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])
    return [int(value) for value in corners]


_READ = "physic_core.types.People"
CHECKS: tuple[Check, ...] = (
    Check(check_masks_lie_on_people, _READ),
    Check(check_people_have_masks_of_their_own, _READ, after=("masks_lie_on_people",)),
    Check(check_boxes_enclose_their_masks, _READ),
    Check(check_scores_are_sorted, _READ),
    Check(check_floor_mask_is_on_the_floor, _READ),
    Check(check_floor_mask_excludes_people, _READ, after=("floor_mask_is_on_the_floor",)),
    Check(check_masks_are_not_shifted, _READ, after=("masks_lie_on_people", "floor_mask_is_on_the_floor")),
    Check(check_masks_are_as_large_as_people, _READ, after=("masks_are_not_shifted",)),
)
"""Checks of a Segmenter, in order of execution."""
