"""How outputs of a HandEstimator are compared: rotations of the fingers and wrists of both
hands.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from physic_testing.conformance.body_estimator import (
    FORMS,
    MIRROR,
    as_matrices,
    shortest,
)
from physic_testing.conformance.known_mistakes import (
    Group,
    KnownMistake,
    Table,
    flipped,
    search_order,
    times,
)
from physic_testing.conformance.output_checks import ROWS, WITHOUT_PEOPLE
from physic_testing.conformance.truth import (
    WRISTS,
    rotation_errors_deg,
    true_hands,
    true_wrists,
)

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hands
    from physic_testing.conformance.cases import Case, Truth, Values

_TURNED = 0.5  # root of the mean square of what a turn by some 45 degrees changes in a matrix
_MIRRORING = (
    "A network for right hands receives the mirrored left hand: mirror its rotation "
    "vectors to (x, -y, -z)."
)
_REST = "Is it a hand at rest for every photo?"
_MEAN = "Is the mean pose of the model added? Rotations are relative to the flat hand."
_BENT_RAD = np.multiply.outer([-0.1, 0.1], [[0, 0, 1]])  # (2, 1, 3); 5.7 degrees
_NAMES = [
    f"{finger}{joint}"
    for finger in ("index", "middle", "pinky", "ring", "thumb")
    for joint in (1, 2, 3)
]


def _values(answer: Hands, case: Case) -> tuple[Values, Truth]:
    """Return the rotation vectors of the fingers (N, 2, 15, 3) and wrists (N, 2, 3), NaN of hands
    that are not found, and confidences (N, 2).
    """
    world = case.truth
    shown = np.where(answer.confidence > 0, 1, np.nan)[..., None]
    wrists = np.full(3, np.nan) if answer.wrists is None else answer.wrists
    values = {"fingers": answer.rotvecs * shown[..., None], "wrists": wrists * shown}
    truth = {"fingers": true_hands(world), "wrists": true_wrists(world)}
    values, truth = (
        {name: shortest(rotvecs) for name, rotvecs in side.items()} for side in (values, truth)
    )
    values["confidence"] = answer.confidence
    truth["confidence"] = world.joints_visible[:, WRISTS].astype(float)
    return values, truth


def _errors(values: Values, truth: Truth) -> dict[str, Any]:
    return {"degrees": rotation_errors_deg(values["fingers"], truth["fingers"])}


def _of_hands(fingers: FloatArray, truth: Truth) -> list[FloatArray]:
    return as_matrices(fingers.reshape(-1, 15, 3), truth)


def _mirrored(side: int, name: str) -> KnownMistake:
    """Return the reading of hands of which those of one side are mirrored."""
    factors = np.ones((2, 1, 3))
    factors[side] = -MIRROR
    return KnownMistake(
        f"of mirrored {name} hands", lambda fingers, _: factors * fingers, _MIRRORING
    )


_READINGS = (
    KnownMistake("with left and right hands exchanged", flipped(1), _MIRRORING),
    _mirrored(0, "left"),
    _mirrored(1, "right"),
    *FORMS,
    KnownMistake("flat in every photo", times(0), _REST, limit=0.75),
    KnownMistake("bent more", lambda fingers, _: fingers + _BENT_RAD, _MEAN, 5.7, " degrees", 10),
)

TABLE = Table(
    _values,
    _errors,
    (
        WITHOUT_PEOPLE,
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
            search=search_order(_NAMES, 2),
        ),
        Group(
            "wrists_are_in_the_cameras_frame",
            "rotations from the T-pose to the camera's frame, the left one first",
            "wrists",
            "of a rotation matrix",
            (KnownMistake("with the sides exchanged", flipped(1), _MIRRORING), *FORMS),
            lambda wrists, truth: as_matrices(wrists.reshape(-1, 1, 3), truth),
            rough=_TURNED,
        ),
        Group(
            "confidence_tells_hidden_hands",
            "confidences that differ between hands, 0 for hands that are not found",
            "confidence",
            "of a probability",
            (KnownMistake("inverted", lambda rows, _: 1 - rows, "1 is sure."),),
            is_telling=True,
        ),
    ),
)
