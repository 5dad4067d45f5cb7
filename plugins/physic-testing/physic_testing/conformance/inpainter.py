"""Checks of an Inpainter: the masked pixels are filled in RGB, and all other pixels are unchanged."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.discovery.error_text import describe_error
from physic_core.errors import PhysicError
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckFailed, expect

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest

__all__ = ["CHECKS"]

_VISIBLE_CHANGE = 8  # grey levels by which a pixel visibly differs


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
    """Most masked pixels no longer show the person."""
    case, answer, truth = subject.case("one person"), subject.result(), subject.case("one person").truth
    telling = truth.masks.any(axis=0) & (
        np.abs(truth.image.astype(int) - truth.empty_image).max(axis=2) > 3 * _VISIBLE_CHANGE
    )
    kept = (np.abs(answer.astype(int) - case.photo).max(axis=2) <= _VISIBLE_CHANGE)[telling]
    expect(
        float(kept.mean()) < 0.5,
        "other colours in most pixels of the person",
        f"{float(kept.mean()):.0%} of the person's pixels are unchanged",
    )


def check_filled_pixels_are_rgb(subject: BackendUnderTest) -> None:
    """The filled pixels have the colours of the true background in RGB order, not BGR."""
    case, answer = subject.case("one person"), subject.result().astype(float)
    truth = case.empty.astype(float)
    right = np.abs(np.median(answer[case.hole], axis=0) - np.median(truth[case.hole], axis=0)).sum()
    turned = np.abs(np.median(answer[case.hole][:, ::-1], axis=0) - np.median(truth[case.hole], axis=0)).sum()
    expect(
        right < 10 or turned > 0.5 * right,
        "colours in RGB order",
        f"an error of {right:.0f} grey levels, but {turned:.0f} with red and blue exchanged",
        "OpenCV reads and writes BGR; images here are RGB.",
    )


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
    from physic_testing.conformance.contract import contract_violations

    subject.result()
    case = subject.case("one person")
    wanted = "an image, or a PhysicError, for a mask of the whole photo"
    try:
        answer = subject.infer(subject.loaded(case), case, (case.photo.copy(), np.ones_like(case.hole)))
    except PhysicError:
        return
    except Exception as error:
        raise CheckFailed(wanted, describe_error(error, subject.kind)) from error
    faults = contract_violations(subject.interface, answer, case)
    expect(not faults, wanted, "; ".join(faults))


_READ = "physic_core.interfaces.Inpainter"
CHECKS: tuple[Check, ...] = (
    Check(check_pixels_outside_the_mask_are_unchanged, _READ),
    Check(check_hole_is_filled, _READ, after=("pixels_outside_the_mask_are_unchanged",)),
    Check(check_filled_pixels_are_rgb, _READ, after=("pixels_outside_the_mask_are_unchanged", "hole_is_filled")),
    Check(check_an_empty_mask_changes_nothing, _READ, after=("pixels_outside_the_mask_are_unchanged",)),
    Check(check_accepts_or_refuses_a_full_mask, _READ),
)
"""Checks of an Inpainter, in order of execution."""
