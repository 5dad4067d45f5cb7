"""Checks of an Inpainter: the masked pixels are filled in RGB, and all other pixels are unchanged."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from physic_core.discovery.error_text import describe_error
from physic_core.errors import PhysicError
from physic_testing.conformance.bias import expect_no_better, expect_no_bias, pixel_shift
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckFailed, expect

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case

_VISIBLE_CHANGE = 8  # grey levels by which a pixel visibly differs
_MIN_PIXELS = 20

MAX_SHIFT_PX, MAX_GAIN = 0.5, 5.0
"""Mean shift, and mean error of the brightness in %, that are treated as zero."""

_READINGS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "of red and blue exchanged": lambda image: image[..., ::-1],
    "without colour": lambda image: np.broadcast_to(image.mean(axis=2, keepdims=True), image.shape),
    "mirrored": lambda image: image[:, ::-1],
    "upside down": lambda image: image[::-1],
}
"""What a wrong fill may be of -> that image (H, W, 3)."""


def check_pixels_outside_the_mask_are_unchanged(subject: BackendUnderTest) -> None:
    """Pixels where the mask is False are unchanged."""
    case, answer = subject.case("one person"), subject.result()
    apart = (answer != case.photo).any(axis=2) & ~case.hole
    changed = int(apart.sum())
    inside = int((answer != case.photo).any(axis=2)[case.hole].sum())
    expect(
        not changed,
        "unchanged pixels where the mask is False",
        f"{changed} of {int((~case.hole).sum())} pixels changed",
        "True marks the pixels to fill." if not inside else "Return np.where(mask[..., None], filled, image).",
    )


def check_hole_is_filled(subject: BackendUnderTest) -> None:
    """Most pixels no longer show the person: not at the border of the person, and not inside."""
    kept: dict[str, list[float]] = {}
    for case, answer in subject.evidence():
        for part, where in _parts_of_people(case).items():
            if where.sum() >= _MIN_PIXELS:
                same = np.abs(answer.astype(int) - case.photo).max(axis=2) <= _VISIBLE_CHANGE
                kept.setdefault(part, []).append(float(same[where].mean()))
    for part, shares in kept.items():
        expect(
            float(np.median(shares)) < 0.5,
            f"other colours in most pixels {part}",
            f"{float(np.median(shares)):.0%} of them are unchanged",
            "" if "inside" in part else "Is the mask shrunk, or blended with the photo at its border?",
        )


def check_fill_has_the_colours_around(subject: BackendUnderTest) -> None:
    """The filled pixels have the colours of the true background: RGB, not darker, not mirrored."""
    own, gains = [], []
    others: dict[str, list[float]] = {name: [] for name in _READINGS}
    for case, answer in subject.evidence():
        filled, truth = answer[case.hole].astype(float), case.empty.astype(float)
        own.append(np.abs(filled - truth[case.hole]).mean())
        people = case.truth.masks.any(axis=0)  # glare has no other brightness
        gains.append(100 * np.log(answer[people].mean() / max(truth[people].mean(), 1)))
        for name, reading in _READINGS.items():
            others[name].append(np.abs(filled - reading(truth)[case.hole]).mean())
    expect_no_better(
        np.array(own),
        {name: np.array(values) for name, values in others.items()},
        1.0,
        "the colours of the background in RGB order, mean error in grey levels",
        {"of red and blue exchanged": "OpenCV reads and writes BGR; images here are RGB."},
    )
    expect_no_bias(np.array(gains), MAX_GAIN, "a fill as bright as the background", " %", "Is the value range right?")


def check_fill_is_not_shifted(subject: BackendUnderTest) -> None:
    """What fills the hole is in place: the mean shift of its structures is below half a pixel."""
    shifts = np.array(
        [
            pixel_shift(answer.astype(float).mean(axis=2), case.empty.astype(float).mean(axis=2), case.hole)
            for case, answer in subject.evidence()
        ]
    )
    for axis, way in enumerate("xy"):
        expect_no_bias(shifts[:, axis], MAX_SHIFT_PX, f"a fill in place along {way}", " px", "Is it resized or padded?")


def _parts_of_people(case: Case) -> dict[str, BoolArray]:
    """Return the pixels (H, W) of parts of people whose colour differs from that of the background."""
    import cv2

    person, truth = case.truth.masks.any(axis=0), case.empty.astype(int)
    telling = person & (np.abs(case.photo - truth).max(axis=2) > 3 * _VISIBLE_CHANGE)
    depth = cv2.distanceTransform(person.astype(np.uint8), cv2.DIST_C, 3)
    return {
        "at the border of people": telling & (depth <= 1),
        "within 3 px of the border of people": telling & (depth <= 3),
        "inside people": telling & (depth > 3),
    }


def check_an_empty_mask_changes_nothing(subject: BackendUnderTest) -> None:
    """With an empty mask, the output equals the input."""
    subject.result()
    case = subject.case("one person")
    try:
        answer = subject.infer(subject.loaded(case), case, (case.photo.copy(), np.zeros_like(case.hole)))
    except Exception as error:
        raise CheckFailed("the photo itself for an empty mask", describe_error(error, subject.kind)) from error
    same = isinstance(answer, np.ndarray) and np.array_equal(answer, case.photo)
    expect(same, "the photo itself for an empty mask", "another image")


def check_accepts_or_refuses_a_full_mask(subject: BackendUnderTest) -> None:
    """With a mask of the whole photo, the output is valid or infer raises a PhysicError."""
    from physic_testing.conformance.contract import case_violations

    subject.result()
    case = subject.case("one person")
    wanted = "an image, or a PhysicError, for a mask of the whole photo"
    try:
        answer = subject.infer(subject.loaded(case), case, (case.photo.copy(), np.ones_like(case.hole)))
    except PhysicError:
        return
    except Exception as error:
        raise CheckFailed(wanted, describe_error(error, subject.kind)) from error
    faults = case_violations(subject.interface, answer, case)
    expect(not faults, wanted, "; ".join(faults))


_READ = "physic_core.interfaces.Inpainter"
_FILLED = ("pixels_outside_the_mask_are_unchanged", "hole_is_filled")
CHECKS: tuple[Check, ...] = (
    Check(check_pixels_outside_the_mask_are_unchanged, _READ),
    Check(check_hole_is_filled, _READ, after=("pixels_outside_the_mask_are_unchanged",)),
    Check(check_fill_has_the_colours_around, _READ, after=_FILLED),
    Check(check_fill_is_not_shifted, _READ, after=(*_FILLED, "fill_has_the_colours_around")),
    Check(check_an_empty_mask_changes_nothing, _READ, after=("pixels_outside_the_mask_are_unchanged",)),
    Check(check_accepts_or_refuses_a_full_mask, _READ),
)
"""Checks of an Inpainter, in order of execution."""
