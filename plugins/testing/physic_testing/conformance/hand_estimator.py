"""How outputs of a HandEstimator are compared: rotations of the fingers and wrists of both
hands.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_testing.conformance.body_estimator import (
    FORMS,
    MIRROR,
    as_matrices,
    expect_radians,
    shortest,
)
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.output_checks import ROWS, WITHOUT_PEOPLE
from physic_testing.conformance.readings import Group, Reading, Table, flipped, times
from physic_testing.conformance.truth import rotation_errors_deg, true_hands, true_wrists

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hands
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case, Truth, Values

MAX_WRIST_ERROR_DEG = 60.0
_MIRRORING = (
    "A network for right hands receives the mirrored left hand: mirror its rotation "
    "vectors to (x, -y, -z)."
)
_REST = "Is it a hand at rest for every photo?"
_NAMES = [
    f"{finger}{joint}"
    for finger in ("index", "middle", "pinky", "ring", "thumb")
    for joint in (1, 2, 3)
]


def _values(answer: Hands, case: Case) -> tuple[Values, Truth]:
    """Return the rotation vectors of the fingers (N, 2, 15, 3), NaN of hands that are not found."""
    shown = (answer.confidence > 0)[..., None, None]
    own = shortest(np.where(shown, answer.rotvecs, np.nan))
    return {"fingers": own}, {"fingers": shortest(true_hands(case.truth))}


def _of_hands(fingers: FloatArray, truth: Truth) -> list[FloatArray]:
    return as_matrices(fingers.reshape(-1, 15, 3), truth)


def _mirrored(side: int, name: str) -> Reading:
    """Return the reading of hands of which those of one side are mirrored."""
    factors = np.ones((2, 1, 3))
    factors[side] = -MIRROR
    return Reading(f"of mirrored {name} hands", lambda fingers, _: factors * fingers, _MIRRORING)


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


_READINGS = (
    Reading("with left and right hands exchanged", flipped(1), _MIRRORING),
    _mirrored(0, "left"),
    _mirrored(1, "right"),
    *FORMS,
    Reading("flat in every photo", times(0), _REST, limit=0.75),
)

TABLE = Table(
    _values,
    (
        WITHOUT_PEOPLE,
        Check(check_angles_are_radians),
        Check(check_wrists_are_in_the_cameras_frame, after=("angles_are_radians",)),
        *ROWS,
    ),
    (
        Group(
            "hands_are_those_of_the_person",
            "rotations of the left fingers, then of the right ones, relative to the flat hand, in "
            "the order of SMPL-X",
            "fingers",
            "of a rotation matrix",
            _READINGS,
            _of_hands,
            order=(_NAMES, 2),
        ),
    ),
    after=("angles_are_radians",),
)
