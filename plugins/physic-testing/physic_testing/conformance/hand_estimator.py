"""Checks of a HandEstimator: radians, and the left hand first."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_testing.conformance.answering import CHECKS_OF_PEOPLE
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.rows import check_rows_follow_the_people
from physic_testing.conformance.truth import rotation_errors_deg, true_hands, true_wrists

if TYPE_CHECKING:
    from physic_testing.conformance.subject import Subject

__all__ = ["CHECKS"]

MOST_WRIST_DEG = 60.0


def check_angles_are_radians(subject: Subject) -> None:
    """Rotation vectors are in radians: none is longer than a full turn."""
    hands = subject.answer(_photo_with_hands(subject))
    longest = float(np.linalg.norm(hands.rotvecs[hands.confidence > 0], axis=-1).max())
    expect(longest < 2 * np.pi + 0.01, "rotation vectors in radians, up to 6.28", f"{longest:.1f}")


def check_left_comes_first(subject: Subject) -> None:
    """Hand 0 is the person's left hand: fingers of the two sides bend about opposite axes."""
    photo = _photo_with_hands(subject)
    hands, truth = subject.answer(photo), true_hands(subject.case(photo).truth)
    shown = hands.confidence > 0
    right = float(rotation_errors_deg(hands.rotvecs, truth)[shown].mean())
    swapped = float(rotation_errors_deg(hands.rotvecs, truth[:, ::-1])[shown].mean())
    expect(
        swapped > 0.5 * right,
        "the left hand first, then the right one",
        f"{right:.0f} degrees off as they are, {swapped:.0f} with the sides exchanged",
        "A network that only knows right hands is shown the mirrored left one: mirror its answer (x, -y, -z).",
    )


def check_wrists_are_in_the_cameras_frame(subject: Subject) -> None:
    """Wrists, where it gives them, turn the hands of the T-pose into the camera's frame: not into the forearm's."""
    photo = _photo_with_hands(subject)
    hands, truth = subject.answer(photo), true_wrists(subject.case(photo).truth)
    if hands.wrists is None:
        return
    shown = hands.confidence > 0
    off = float(rotation_errors_deg(hands.wrists, truth)[shown].mean())
    swapped = float(rotation_errors_deg(hands.wrists, truth[:, ::-1])[shown].mean())
    expect(
        min(off, swapped) < MOST_WRIST_DEG,
        f"rotations from the T-pose to the camera's frame, within {MOST_WRIST_DEG:.0f} degrees",
        f"{off:.0f} degrees off",
        "Are they against the forearm, in an OpenGL camera's frame, or in degrees?",
    )


def check_left_wrist_comes_first(subject: Subject) -> None:
    """Wrist 0, where it gives them, is that of the person's left hand, and no mirror image."""
    photo = _photo_with_hands(subject)
    hands, truth = subject.answer(photo), true_wrists(subject.case(photo).truth)
    if hands.wrists is None:
        return
    shown = hands.confidence > 0
    off = float(rotation_errors_deg(hands.wrists, truth)[shown].mean())
    swapped = float(rotation_errors_deg(hands.wrists, truth[:, ::-1])[shown].mean())
    expect(
        off < swapped,
        "the left wrist first, then the right one",
        f"{off:.0f} degrees off as they are, {swapped:.0f} with the sides exchanged",
        "A network that only knows right hands is shown the mirrored left one: mirror its answer (x, -y, -z).",
    )


def _photo_with_hands(subject: Subject) -> str:
    """The first photo in which it finds a hand: in small ones hands are a few pixels wide."""
    for name in ("one person", "close"):
        if (subject.answer(name).confidence > 0).any():
            return name
    raise CheckSkipped("it finds no hand in the photos")


_READ = "physic_core.types.Hands"
CHECKS: tuple[Check, ...] = (
    *CHECKS_OF_PEOPLE,
    Check(check_angles_are_radians, _READ),
    Check(check_left_comes_first, _READ, after=("angles_are_radians",)),
    Check(check_wrists_are_in_the_cameras_frame, _READ, after=("angles_are_radians",)),
    Check(check_left_wrist_comes_first, _READ, after=("angles_are_radians", "wrists_are_in_the_cameras_frame")),
    Check(check_rows_follow_the_people, _READ),
)
"""In the order in which they make sense."""
