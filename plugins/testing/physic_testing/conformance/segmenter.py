"""How outputs of a Segmenter are compared: masks, boxes, scores and the floor."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.backends.people import boxes_from_masks
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import expect
from physic_testing.conformance.known_mistakes import (
    Group,
    KnownMistake,
    Table,
    flipped,
    plus,
    shifted,
)
from physic_testing.conformance.output_checks import COLOURS, WITHOUT_PEOPLE
from physic_testing.metrics import mask_iou

if TYPE_CHECKING:
    from physic_core.types import FloatArray, People
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case, Truth, Values

MIN_IOU = 0.3
"""Minimum IoU with the true mask; it detects wrong pixels and does not judge the accuracy."""

MIN_SAME = 0.5
MIN_HELD = 0.8
"""Minimum IoU of a mask with the person that it shows, and share of a person whom a mask holds."""


def _values(answer: People, case: Case) -> tuple[Values, Truth]:
    """Return masks matched to the true people (NaN if undetected), the floor (1, H, W), NaN beside
    people, and how far boxes reach beyond their masks.
    """
    true = case.truth.masks
    masks = np.full(true.shape, np.nan)
    boxes = np.full((len(true), 4), np.nan)
    iou = np.vstack([mask_iou(answer.masks, true), np.zeros(len(true))])
    for i in np.flatnonzero(iou.max(axis=0) > MIN_SAME):
        best = int(iou[:, i].argmax())
        masks[i] = answer.masks[best]
        boxes[i] = answer.boxes[best] - boxes_from_masks(answer.masks[[best]])[0]
    people = true.any(axis=0)
    floor = np.nan if answer.floor is None else answer.floor
    floor, true_floor = (
        np.where(case.hole & ~people, np.nan, each)[None]
        for each in (floor, case.truth.empty_floor_mask & ~people)
    )
    values = {"masks": masks, "floor": floor, "boxes": boxes, "iou": iou.max(axis=0)}
    return values, {
        "masks": true.astype(float),
        "floor": true_floor,
        "boxes": np.zeros(boxes.shape),
    }


def _errors(values: Values, truth: Truth) -> dict[str, Any]:
    return {"IoU": values["iou"]}


def _blurred(masks: FloatArray, truth: Truth) -> list[FloatArray]:
    """Return blurred masks, so that a part of a pixel shows."""
    from scipy.ndimage import gaussian_filter

    smooth = gaussian_filter(np.nan_to_num(masks), (0, 1, 1))
    return [mask.ravel() for mask in np.where(np.isfinite(masks), smooth, np.nan)]


def _larger(masks: FloatArray, truth: Truth) -> FloatArray:
    """Return masks 2 % larger about the centre of the photo, to first order."""
    down, right = np.gradient(masks, axis=(1, 2))
    y, x = (np.arange(side) - (side - 1) / 2 for side in masks.shape[1:])
    return np.asarray(masks - 0.02 * (down * y[:, None] + right * x))


def _farther_out(masks: FloatArray, truth: Truth) -> FloatArray:
    """Return masks with their border 1 px farther out, as half of the difference to farther in."""
    from scipy.ndimage import maximum_filter, minimum_filter

    wide, narrow = (find(masks, (1, 3, 3)) for find in (maximum_filter, minimum_filter))
    return np.asarray(masks + (wide - narrow) / 2)


_PADDING = (
    "Is the padding of the network's input subtracted, and the mask resized by pixel centers?"
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


def _in_place(limit: float) -> tuple[KnownMistake, ...]:
    """Return the readings of masks that are moved by more than ``limit`` px."""
    return (
        KnownMistake("mirrored", flipped(2), _TURNED),
        KnownMistake("upside down", flipped(1), _TURNED),
        KnownMistake("to the right", shifted(2), _PADDING, 1, " px", limit),
        KnownMistake("down", shifted(1), _PADDING, 1, " px", limit),
        KnownMistake("larger about the photo's center", _larger, _PADDING, 2, " %", 0.75),
    )


def check_masks_lie_on_people(subject: BackendUnderTest) -> None:
    """The best mask overlaps one person, and people side by side have masks of their own."""
    answer = subject.result()
    true = subject.case("one person").truth.masks
    best, inverted = (mask_iou(m, true).max(initial=0) for m in (answer.masks, ~answer.masks))
    expect(
        best >= MIN_IOU,
        f"a mask with an IoU of at least {MIN_IOU} with the true mask",
        f"{best:.2f} of {len(answer)} masks, and {inverted:.2f} if they are inverted",
        "True marks the person. Is the output turned, resized and moved back to the photo?",
    )
    answer = subject.result("several people")
    true = subject.case("several people").truth.masks
    covered = (answer.masks[:, None] & true).sum((2, 3)) / true.sum((1, 2))
    expect(
        not (covered > MIN_HELD).all(axis=1).any(),
        f"one mask for each of {len(true)} people",
        "a mask that holds all of them",
        "Is it a semantic class? Masks are those of instances.",
    )
    expect(
        bool((np.diff(answer.scores) <= 0).all()),
        "people sorted by score, in descending order",
        f"{np.round(answer.scores, 3).tolist()}",
    )


TABLE = Table(
    _values,
    _errors,
    (
        WITHOUT_PEOPLE,
        Check(check_masks_lie_on_people),
        COLOURS,
    ),
    (
        Group(
            "masks_are_in_place",
            "masks of people in place",
            "masks",
            "of a mask",
            (
                *_in_place(0.5),
                KnownMistake("farther out on all sides", _farther_out, _DILATED, 1, " px", 2.5),
            ),
            _blurred,
            after=("masks_lie_on_people",),
        ),
        Group(
            "floor_is_in_place",
            "the floor in place, without people",
            "floor",
            "of a mask",
            (
                *_in_place(0.3),
                KnownMistake("inverted", lambda floor, _: 1 - floor, "True marks the floor."),
                KnownMistake(
                    "with people",
                    lambda floor, truth: np.maximum(floor, truth["masks"].any(axis=0)),
                    "Where people are, the floor is False.",
                ),
            ),
            _blurred,
        ),
        Group(
            "boxes_are_tight",
            "boxes of masks, end exclusive",
            "boxes",
            "px",
            tuple(
                KnownMistake(f"too far at the {edge}", plus(*step), _EXCLUSIVE, 1, " px", 0.5)
                for edge, step in zip(("left", "top", "right", "bottom"), np.eye(4), strict=True)
            ),
            rough=8,
        ),
    ),
)
