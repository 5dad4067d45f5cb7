"""How outputs of a HandEstimator are compared: rotations of the fingers and wrists of both
hands.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.joints import JOINT_INDEX
from physic_testing.conformance.body_estimator import (
    at_rest,
    bent,
    expect_radians,
    matrices,
    mirrored,
    turns,
)
from physic_testing.conformance.changes import CHANGES
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.output_checks import PEOPLE_CHECKS
from physic_testing.conformance.readings import Group, Reading, Table, Values, changed
from physic_testing.conformance.row_order import ROW_CHECKS
from physic_testing.conformance.truth import rotation_errors_deg, true_hands, true_wrists

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hands
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case
    from physic_testing.conformance.changes import Change

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


def _act(values: Values, change: Change, case: Case) -> Values:
    fingers = values["fingers"]
    return {"fingers": mirrored(fingers)[:, ::-1] if change.mirrors else fingers}


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
    _act,
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
            others=(
                "with an offset that all have",
                "Add the mean pose of MANO: its rotations are of a relaxed hand.",
            ),
        ),
    ),
    "physic_core.types.Hands",
    lambda values, truth: bent(values["fingers"], truth["fingers"]),
    CHANGES[:1],
    ("angles_are_radians",),
)


def check_angles_are_radians(subject: BackendUnderTest) -> None:
    """Rotation vectors are in radians: no vector is longer than 2 pi."""
    hands = subject.result(_photo_with_hands(subject))
    expect_radians(hands.rotvecs[hands.confidence > 0])


def check_confidence_is_that_of_each_hand(subject: BackendUnderTest) -> None:
    """A backend that is exact has no higher confidence of hidden hands, and not the same confidence
    of all hands.
    """
    from physic_testing.conformance.exactness import is_proven

    if not is_proven(subject, TABLE):
        raise CheckSkipped(
            "only for a network that returns the ground truth ('exact' in its capabilities)"
        )
    evidence = subject.evidence()
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
    wanted = (
        f"rotations from the T-pose to the camera's frame, the left one first, within "
        f"{MAX_WRIST_ERROR_DEG:.0f} degrees"
    )
    got = f"{off:.0f} degrees off as they are, {swapped:.0f} with the sides exchanged"
    expect(off < swapped, wanted, got, _MIRRORING)
    expect(
        off < MAX_WRIST_ERROR_DEG,
        wanted,
        got,
        "Are they relative to the forearm, of an OpenGL camera, or in degrees?",
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
    Check(check_confidence_is_that_of_each_hand, TABLE.read, unless=BLIND),
    Check(check_wrists_are_in_the_cameras_frame, TABLE.read, after=("angles_are_radians",)),
    *ROW_CHECKS,
)
"""Further checks of a HandEstimator, in order of execution."""
