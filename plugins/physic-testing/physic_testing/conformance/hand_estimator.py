"""How outputs of a HandEstimator are compared: rotations of the fingers and wrists of both
hands.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.joints import JOINT_INDEX
from physic_testing.conformance.body_estimator import (
    at_rest,
    expect_radians,
    matrices,
    mirrored,
    turns,
)
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.output_checks import PEOPLE_CHECKS, ROW_CHECKS
from physic_testing.conformance.readings import Group, Reading, Table, Values, changed
from physic_testing.conformance.truth import rotation_errors_deg, true_hands, true_wrists

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hands
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case

MAX_WRIST_ERROR_DEG = 60.0
_WRISTS = [JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"]]
_MIRRORING = (
    "A network for right hands receives the mirrored left hand: mirror its rotation "
    "vectors to (x, -y, -z)."
)
_NAMES = [
    f"{finger}{joint}"
    for finger in ("index", "middle", "pinky", "ring", "thumb")
    for joint in (1, 2, 3)
]


def _values(answer: Hands, case: Case, truth: Values) -> Values:
    shown = (answer.confidence > 0)[..., None, None]
    return {"fingers": matrices(np.where(shown, answer.rotvecs, np.nan))}


def _of_hands(values: Values, truth: Values, case: Case) -> list[FloatArray]:
    return [hand.ravel() for person in values["fingers"] for hand in person]


def _one_side(side: int) -> Reading:
    def make(fingers: FloatArray) -> FloatArray:
        return np.where((np.arange(2) == side)[:, None, None, None], mirrored(fingers), fingers)

    return Reading(
        f"of mirrored {('left', 'right')[side]} hands", changed(fingers=make), _MIRRORING
    )


TABLE = Table(
    _values,
    lambda answer, case: {"fingers": matrices(true_hands(case.truth))},
    (
        Group(
            "hands_are_those_of_the_person",
            "rotations of the left fingers, then of the right ones, relative to the flat hand, in "
            "the order of SMPL-X",
            "of a rotation matrix",
            _of_hands,
            (
                Reading(
                    "with left and right hands exchanged",
                    changed(fingers=lambda f: f[:, ::-1]),
                    _MIRRORING,
                ),
                _one_side(0),
                _one_side(1),
                *turns("fingers"),
                Reading(
                    "flat in every photo",
                    changed(fingers=at_rest),
                    "Is it a hand at rest for every photo?",
                    limit=0.75,
                ),
            ),
            order=("fingers", _NAMES, 2),
        ),
    ),
    "physic_core.types.Hands",
    ("angles_are_radians",),
)


def check_angles_are_radians(subject: BackendUnderTest) -> None:
    """Rotation vectors are in radians: no vector is longer than 2 pi."""
    hands = subject.result(_photo_with_hands(subject))
    expect_radians(hands.rotvecs[hands.confidence > 0])


def check_wrists_are_in_the_cameras_frame(subject: BackendUnderTest) -> None:
    """`wrists`, if given, rotates each hand from the T-pose to the camera frame, the left one
    first.
    """
    photo = _photo_with_hands(subject)
    hands = subject.result(photo)
    truth = true_wrists(subject.case(photo).truth)
    if hands.wrists is None:
        return
    shown = hands.confidence > 0
    off, swapped = (
        float(rotation_errors_deg(hands.wrists, t)[shown].mean()) for t in (truth, truth[:, ::-1])
    )
    expect(
        off < min(swapped, MAX_WRIST_ERROR_DEG),
        "rotations from the T-pose to the camera's frame, the left one first",
        f"{off:.0f} degrees off as they are, {swapped:.0f} with the sides exchanged",
        f"Relative to the forearm, of an OpenGL camera, or in degrees? {_MIRRORING}",
    )


def _photo_with_hands(subject: BackendUnderTest) -> str:
    """Return the first photo in which the backend detects a hand; skip the check if there is
    none.
    """
    for name in ("one person", "close"):
        if (subject.result(name).confidence > 0).any():
            return name
    raise CheckSkipped("it detects no hand in the photos")


CHECKS: tuple[Check, ...] = (
    *PEOPLE_CHECKS,
    Check(check_angles_are_radians, TABLE.read),
    Check(check_wrists_are_in_the_cameras_frame, TABLE.read, after=("angles_are_radians",)),
    *ROW_CHECKS,
)
"""Further checks of a HandEstimator, in order of execution."""
