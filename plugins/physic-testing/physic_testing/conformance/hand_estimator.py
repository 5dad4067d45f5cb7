"""Checks of a HandEstimator: radians, left hand before right hand, and wrists in the camera frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.joints import JOINT_INDEX
from physic_testing.conformance.bias import MIN_UNITS, expect_follows, expect_no_better, expect_order
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.exactness import PROVEN, agreement
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.output_checks import PEOPLE_CHECKS
from physic_testing.conformance.row_order import check_rows_follow_the_people
from physic_testing.conformance.truth import rotation_errors_deg, true_hands, true_wrists

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest

MAX_WRIST_ERROR_DEG = 60.0
_MIRROR = (1, -1, -1)
_WRISTS = [JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"]]
_MIRRORING = "A network for right hands receives the mirrored left hand: mirror its rotation vectors to (x, -y, -z)."


def check_angles_are_radians(subject: BackendUnderTest) -> None:
    """Rotation vectors are in radians: no vector is longer than 2 pi."""
    hands = subject.result(_photo_with_hands(subject))
    longest = float(np.linalg.norm(hands.rotvecs[hands.confidence > 0], axis=-1).max())
    expect(longest < 2 * np.pi + 0.01, "rotation vectors in radians, at most 6.28 long", f"{longest:.1f}")


def check_hands_are_those_of_the_person(subject: BackendUnderTest) -> None:
    """Hand 0 is the left one; no hand is mirrored, and no rotation is inverse."""
    fingers, true, sides = _fingers(subject)
    readings = {
        "with left and right hands exchanged": fingers[:, ::-1],
        "of left hands mirrored": np.stack([fingers[:, 0] * _MIRROR, fingers[:, 1]], axis=1),
        "of right hands mirrored": np.stack([fingers[:, 0], fingers[:, 1] * _MIRROR], axis=1),
        "inverse": -fingers,
    }
    expect_no_better(
        _errors(fingers, true, sides),
        {words: _errors(found, true, sides) for words, found in readings.items()},
        0.1,
        "rotations of the left fingers, then of the right ones, mean error in degrees",
        {words: _MIRRORING for words in readings if "mirrored" in words},
    )


def check_finger_joints_are_in_order(subject: BackendUnderTest) -> None:
    """The order is index, middle, pinky, ring, thumb, each from the palm to the tip."""
    fingers, true, sides = _fingers(subject)
    apart = rotation_errors_deg(*np.broadcast_arrays(fingers[:, :, :, None], true[:, :, None]))
    names = [f"{finger}{joint}" for finger in ("index", "middle", "pinky", "ring", "thumb") for joint in (1, 2, 3)]
    expect_order(
        np.where(sides[..., None, None], apart, np.nan).reshape(-1, len(names), len(names)),
        names,
        0.1,
        "fingers in the order of SMPL-X, each from the palm to the tip, mean error in degrees",
        "It is index, middle, pinky, ring, thumb.",
    )


def check_fingers_follow_the_photo(subject: BackendUnderTest) -> None:
    """Detected hands are not flat in all photos."""
    fingers, true, sides = _fingers(subject)
    expect_follows(list(fingers[sides]), list(true[sides]), "rotvecs")


def check_rotations_are_relative_to_the_flat_hand(subject: BackendUnderTest) -> None:
    """The rotations have no common offset, such as that of a relaxed hand."""
    fingers, true, sides = _fingers(subject)
    words = "without what all others have too much"
    expect_no_better(
        _errors(fingers, true, sides),
        {words: _errors(fingers - _common_offset(fingers, true, sides), true, sides)},
        0.1,
        "rotations relative to the flat hand, mean error in degrees",
        {words: "Add the mean pose of MANO: its rotations are relative to a relaxed hand."},
    )


def check_confidence_is_that_of_each_hand(subject: BackendUnderTest) -> None:
    """A backend that is exact has no higher confidence of hidden hands, and not the same confidence of all hands."""
    evidence = subject.evidence()
    if float(np.median([agreement(subject.interface, hands, case).share for case, hands in evidence])) < PROVEN:
        raise CheckSkipped("not exact")
    seen = np.concatenate([case.truth.joints_visible[:, _WRISTS] for case, _ in evidence])
    sure = np.concatenate([hands.confidence for _, hands in evidence])
    one = seen[:, 0] != seen[:, 1]
    expect(
        not one.any() or float(sure[one][seen[one]].mean()) > float(sure[one][~seen[one]].mean()),
        "a higher confidence of a hand in sight than of the person's hidden hand",
        f"{sure[one][seen[one]].mean():.2f} in sight, {sure[one][~seen[one]].mean():.2f} hidden",
        "Are they exchanged between left and right, or a constant?",
    )


def check_wrists_are_in_the_cameras_frame(subject: BackendUnderTest) -> None:
    """`wrists`, if given, rotates each hand from the T-pose to the camera frame, not to the forearm."""
    errors = _wrist_errors_deg(subject)
    if errors is None:
        return
    off, swapped = errors
    expect(
        min(off, swapped) < MAX_WRIST_ERROR_DEG,
        f"rotations from the T-pose to the camera's frame, within {MAX_WRIST_ERROR_DEG:.0f} degrees",
        f"{off:.0f} degrees off",
        "Are they relative to the forearm, in an OpenGL camera frame, or in degrees?",
    )


def check_left_wrist_comes_first(subject: BackendUnderTest) -> None:
    """`wrists`, if given, has the left wrist first, and neither wrist is mirrored."""
    errors = _wrist_errors_deg(subject)
    if errors is None:
        return
    off, swapped = errors
    expect(
        off < swapped,
        "the left wrist first, then the right one",
        f"{off:.0f} degrees off as they are, {swapped:.0f} with the sides exchanged",
        _MIRRORING,
    )


def _wrist_errors_deg(subject: BackendUnderTest) -> tuple[float, float] | None:
    """Return the mean errors of the wrists of detected hands, as they are and with sides exchanged; None without."""
    photo = _photo_with_hands(subject)
    hands, truth = subject.result(photo), true_wrists(subject.case(photo).truth)
    if hands.wrists is None:
        return None
    shown = hands.confidence > 0
    off, swapped = (rotation_errors_deg(hands.wrists, t)[shown].mean() for t in (truth, truth[:, ::-1]))
    return float(off), float(swapped)


def _fingers(subject: BackendUnderTest) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return estimated and true rotations (N, 2, 15, 3) of all people, and which hands (N, 2) are detected."""
    found = [(answer.rotvecs, true_hands(case.truth), answer.confidence > 0) for case, answer in subject.evidence()]
    fingers, true, sides = (np.concatenate(parts) for parts in zip(*found, strict=True))
    if sides.sum() < MIN_UNITS:
        raise CheckSkipped(f"it detects {int(sides.sum())} hands in the photos of people, {MIN_UNITS} are needed")
    return fingers, true, sides


def _errors(fingers: FloatArray, true: FloatArray, sides: BoolArray) -> FloatArray:
    """Return the mean error (2 N,) of each detected hand, degrees; NaN for the others."""
    return np.where(sides, rotation_errors_deg(fingers, true).mean(2), np.nan).reshape(-1)


def _common_offset(fingers: FloatArray, true: FloatArray, sides: BoolArray) -> FloatArray:
    """Return what all other detected hands of a side have too much (N, 2, 15, 3), so that none explains itself."""
    apart = np.where(sides[..., None, None], fingers - true, 0)
    others = sides.sum(0) - sides
    offset: FloatArray = (apart.sum(0) - apart) / np.maximum(others, 1)[..., None, None]
    return offset


def _photo_with_hands(subject: BackendUnderTest) -> str:
    """Return the first photo in which the backend detects a hand; skip the check if there is none."""
    for name in ("one person", "close"):
        if (subject.result(name).confidence > 0).any():
            return name
    raise CheckSkipped("it detects no hand in the photos")


_READ = "physic_core.types.Hands"
_SIDES = ("angles_are_radians", "hands_are_those_of_the_person")
_ORDERED = (*_SIDES, "finger_joints_are_in_order")
_FOLLOWED = (*_ORDERED, "fingers_follow_the_photo")
CHECKS: tuple[Check, ...] = (
    *PEOPLE_CHECKS,
    Check(check_angles_are_radians, _READ),
    Check(check_hands_are_those_of_the_person, _READ, after=("angles_are_radians",)),
    Check(check_finger_joints_are_in_order, _READ, after=_SIDES, unless=BLIND),
    Check(check_fingers_follow_the_photo, _READ, after=_ORDERED, unless=BLIND),
    Check(
        check_rotations_are_relative_to_the_flat_hand,
        _READ,
        after=(*_ORDERED, "fingers_follow_the_photo"),
        unless=BLIND,
    ),
    Check(check_confidence_is_that_of_each_hand, _READ, unless=BLIND),
    Check(check_wrists_are_in_the_cameras_frame, _READ, after=("angles_are_radians",)),
    Check(check_left_wrist_comes_first, _READ, after=("angles_are_radians", "wrists_are_in_the_cameras_frame")),
    Check(check_rows_follow_the_people, _READ),
)
"""Checks of a HandEstimator, in order of execution."""
