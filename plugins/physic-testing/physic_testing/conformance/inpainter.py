"""Checks of an Inpainter: the hole is filled in RGB, and nothing else is touched."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.discovery.error_text import describe
from physic_core.errors import PhysicError
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckFailed, expect

if TYPE_CHECKING:
    from physic_testing.conformance.subject import Subject

__all__ = ["CHECKS"]

_SEEN = 8  # grey levels by which a pixel visibly differs


def check_pixels_outside_the_mask_are_unchanged(subject: Subject) -> None:
    """Where the mask is False, every pixel keeps its value."""
    case, answer = subject.case("one person"), subject.answer()
    apart = (answer != case.photo).any(axis=2) & ~case.hole
    changed = int(apart.sum())
    inside = int((answer != case.photo).any(axis=2)[case.hole].sum())
    expect(
        not changed,
        "the very same pixels where the mask is False",
        f"{changed} of {int((~case.hole).sum())} pixels changed",
        "True means remove." if not inside else "np.where(mask[..., None], filled, image) as the last step.",
    )


def check_the_hole_is_filled(subject: Subject) -> None:
    """Where the mask is True, the person is gone."""
    case, answer, truth = subject.case("one person"), subject.answer(), subject.case("one person").truth
    telling = truth.masks.any(axis=0) & (np.abs(truth.image.astype(int) - truth.empty_image).max(axis=2) > 3 * _SEEN)
    kept = (np.abs(answer.astype(int) - case.photo).max(axis=2) <= _SEEN)[telling]
    expect(
        float(kept.mean()) < 0.5,
        "other colours where the person was, in most of the mask",
        f"{float(kept.mean()):.0%} of the person's pixels are as they were",
    )


def check_the_fill_is_rgb(subject: Subject) -> None:
    """What is filled in has the colours of what is around, not with red and blue exchanged."""
    case, answer = subject.case("one person"), subject.answer().astype(float)
    truth = case.empty.astype(float)
    right = np.abs(np.median(answer[case.hole], axis=0) - np.median(truth[case.hole], axis=0)).sum()
    turned = np.abs(np.median(answer[case.hole][:, ::-1], axis=0) - np.median(truth[case.hole], axis=0)).sum()
    expect(
        right < 10 or turned > 0.5 * right,
        "colours in the order red, green, blue",
        f"a fill that is {right:.0f} grey levels off as it is, and {turned:.0f} with red and blue exchanged",
        "OpenCV reads and writes BGR; images here are RGB.",
    )


def check_an_empty_mask_changes_nothing(subject: Subject) -> None:
    """Nothing to remove: the photo comes back."""
    subject.answer()
    case = subject.case("one person")
    try:
        answer = subject.ask(subject.loaded(case), case, (case.photo.copy(), np.zeros_like(case.hole)))
    except Exception as error:
        raise CheckFailed("the photo itself for an empty mask", describe(error, subject.kind)) from error
    same = isinstance(answer, np.ndarray) and np.array_equal(answer, case.photo)
    expect(same, "the photo itself for an empty mask", "another image")


def check_accepts_or_refuses_a_full_mask(subject: Subject) -> None:
    """For a mask of the whole photo the output is valid, or infer raises a PhysicError."""
    from physic_testing.conformance.asking import form_faults

    subject.answer()
    case = subject.case("one person")
    wanted = "an image for a mask that covers everything, or a PhysicError that says that nothing is left to go by"
    try:
        answer = subject.ask(subject.loaded(case), case, (case.photo.copy(), np.ones_like(case.hole)))
    except PhysicError:
        return
    except Exception as error:
        raise CheckFailed(wanted, describe(error, subject.kind)) from error
    faults = form_faults(subject.interface, answer, case)
    expect(not faults, wanted, "; ".join(faults))


_READ = "physic_core.interfaces.Inpainter"
CHECKS: tuple[Check, ...] = (
    Check(check_pixels_outside_the_mask_are_unchanged, _READ),
    Check(check_the_hole_is_filled, _READ, after=("pixels_outside_the_mask_are_unchanged",)),
    Check(check_the_fill_is_rgb, _READ, after=("pixels_outside_the_mask_are_unchanged", "the_hole_is_filled")),
    Check(check_an_empty_mask_changes_nothing, _READ, after=("pixels_outside_the_mask_are_unchanged",)),
    Check(check_accepts_or_refuses_a_full_mask, _READ),
)
"""In the order in which they make sense."""
