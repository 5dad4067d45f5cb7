"""Checks of a HandEstimator: radians, left hand before right hand, and wrists in the camera frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.output_checks import PEOPLE_CHECKS
from physic_testing.conformance.row_order import check_rows_follow_the_people
from physic_testing.conformance.truth import rotation_errors_deg, true_hands, true_wrists

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest

__all__ = ["CHECKS"]

MAX_WRIST_ERROR_DEG = 60.0


def check_angles_are_radians(subject: BackendUnderTest) -> None:
    """Rotation vectors are in radians: no vector is longer than 2 pi."""
    hands = subject.result(_photo_with_hands(subject))
    longest = float(np.linalg.norm(hands.rotvecs[hands.confidence > 0], axis=-1).max())
    expect(longest < 2 * np.pi + 0.01, "rotation vectors in radians, at most 6.28 long", f"{longest:.1f}")


def check_left_hand_comes_first(subject: BackendUnderTest) -> None:
    """Hand 0 is the person's left hand and hand 1 the right hand."""
    photo = _photo_with_hands(subject)
    hands, truth = subject.result(photo), true_hands(subject.case(photo).truth)
    shown = hands.confidence > 0
    right = float(rotation_errors_deg(hands.rotvecs, truth)[shown].mean())
    swapped = float(rotation_errors_deg(hands.rotvecs, truth[:, ::-1])[shown].mean())
    expect(
        swapped > 0.5 * right,
        "the left hand first, then the right one",
        f"{right:.0f} degrees off as they are, {swapped:.0f} with the sides exchanged",
        "A network for right hands receives the mirrored left hand: mirror its rotation vectors to (x, -y, -z).",
    )


def check_wrists_are_in_the_cameras_frame(subject: BackendUnderTest) -> None:
    """`wrists`, if given, rotates each hand from the T-pose to the camera frame, not to the forearm."""
    photo = _photo_with_hands(subject)
    hands, truth = subject.result(photo), true_wrists(subject.case(photo).truth)
    if hands.wrists is None:
        return
    shown = hands.confidence > 0
    off = float(rotation_errors_deg(hands.wrists, truth)[shown].mean())
    swapped = float(rotation_errors_deg(hands.wrists, truth[:, ::-1])[shown].mean())
    expect(
        min(off, swapped) < MAX_WRIST_ERROR_DEG,
        f"rotations from the T-pose to the camera's frame, within {MAX_WRIST_ERROR_DEG:.0f} degrees",
        f"{off:.0f} degrees off",
        "Are they relative to the forearm, in an OpenGL camera frame, or in degrees?",
    )


def check_left_wrist_comes_first(subject: BackendUnderTest) -> None:
    """`wrists`, if given, has the left wrist first, and neither wrist is mirrored."""
    photo = _photo_with_hands(subject)
    hands, truth = subject.result(photo), true_wrists(subject.case(photo).truth)
    if hands.wrists is None:
        return
    shown = hands.confidence > 0
    off = float(rotation_errors_deg(hands.wrists, truth)[shown].mean())
    swapped = float(rotation_errors_deg(hands.wrists, truth[:, ::-1])[shown].mean())
    expect(
        off < swapped,
        "the left wrist first, then the right one",
        f"{off:.0f} degrees off as they are, {swapped:.0f} with the sides exchanged",
        "A network for right hands receives the mirrored left hand: mirror its rotation vectors to (x, -y, -z).",
    )


def _photo_with_hands(subject: BackendUnderTest) -> str:
    """Return the first photo in which the backend detects a hand; skip the check if there is none."""
    for name in ("one person", "close"):
        if (subject.result(name).confidence > 0).any():
            return name
    raise CheckSkipped("it detects no hand in the photos")


_READ = "physic_core.types.Hands"
CHECKS: tuple[Check, ...] = (
    *PEOPLE_CHECKS,
    Check(check_angles_are_radians, _READ),
    Check(check_left_hand_comes_first, _READ, after=("angles_are_radians",)),
    Check(check_wrists_are_in_the_cameras_frame, _READ, after=("angles_are_radians",)),
    Check(check_left_wrist_comes_first, _READ, after=("angles_are_radians", "wrists_are_in_the_cameras_frame")),
    Check(check_rows_follow_the_people, _READ),
)
"""Checks of a HandEstimator, in order of execution."""
