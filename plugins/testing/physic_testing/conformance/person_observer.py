"""How outputs of a PersonObserver are compared: which parts touch, where the faces look, and the
sides in a mirrored photo.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.types import mirrored_order
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.output_checks import COLOURS, ROWS, WITHOUT_PEOPLE
from physic_testing.conformance.readings import Group, Reading, Table, reordered, times
from physic_testing.conformance.truth import true_head, true_touch

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Observations
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case, Truth, Values

MIRROR_TOLERANCE = 0.1
"""Difference of probabilities that may be an error."""

_OWN_LEFT = "Are sides those of the picture? Left is the person's own."
_ORDER = "The order is that of physic_core.types.TOUCH_PARTS."


def _values(answer: Observations, case: Case) -> tuple[Values, Truth]:
    found = {"touch": answer.touch.astype(float), "head": answer.head.astype(float)}
    truth = {"touch": true_touch(case.truth).astype(float), "head": true_head(case.truth)}
    return found, truth


def check_mirrored_photo_exchanges_sides(subject: BackendUnderTest) -> None:
    """For a mirrored photo, what is said of the left side is said of the right one."""
    found = []
    for case, answer in subject.evidence():
        wanted = "valid output for a mirrored photo, or a PhysicError"
        again = subject.call(wanted, case, _mirrored(subject.request(case)), may_refuse=True)
        if again is not None:
            own, other = _sides(answer), _sides(again)
            differ = np.abs(own - own[:, ::-1]) > MIRROR_TOLERANCE  # False for NaN
            apart = np.stack([np.abs(own - other), np.abs(own - other[:, ::-1])])[:, differ]
            found.append(apart[:, np.isfinite(apart).all(0)])
    apart = np.concatenate(found, 1) if found else np.zeros((2, 0))
    if not apart.size:
        raise CheckSkipped("of no mirrored photo it tells the sides of a person apart")
    same, exchanged = apart.mean(1).tolist()
    expect(
        exchanged <= same + MIRROR_TOLERANCE,
        "the sides exchanged in a mirrored photo",
        f"a mean difference of {exchanged:.2f} with the sides exchanged, of {same:.2f} without",
        "Does the place of a limb follow its keypoint? Is a mirrored crop mirrored back?",
    )


def _mirrored(request: Any) -> Any:
    """Return the request for the mirrored photo."""
    people = request.people
    keypoints = request.keypoints
    camera = request.intrinsics
    width = request.image.shape[1]
    joints = mirrored_order(keypoints.joint_set.names)
    points = [width - 1, 0] + keypoints.points[:, joints] * [-1, 1]
    boxes = people.boxes[:, [2, 1, 0, 3]] * [-1, 1, -1, 1] + [width, 0, width, 0]
    return replace(
        request,
        image=np.ascontiguousarray(request.image[:, ::-1]),
        people=replace(people, masks=np.ascontiguousarray(people.masks[..., ::-1]), boxes=boxes),
        keypoints=replace(keypoints, points=points, confidence=keypoints.confidence[:, joints]),
        intrinsics=replace(camera, cx=width - 1 - camera.cx),
    )


def _sides(answer: Observations) -> FloatArray:
    """Return what is said of the left and the right side (N, 2, 3), in [0, 1]."""
    both = [answer.touch[:, :2], answer.touch[:, 2:4], answer.holds]
    return np.stack(both, 2).astype(np.float64)


TABLE = Table(
    _values,
    (WITHOUT_PEOPLE, Check(check_mirrored_photo_exchanges_sides, unless=BLIND), *ROWS, COLOURS),
    (
        Group(
            "touch_is_that_of_the_parts",
            "probabilities that the left and right foot, the left and right hand and the seat "
            "touch, left ones on the person's own left",
            "touch",
            "of a probability",
            (
                Reading("inverted", lambda p, _: 1 - p, "1 is touch."),
                Reading("with left and right exchanged", reordered([1, 0, 3, 2, 4]), _OWN_LEFT),
                Reading("with hands for feet", reordered([2, 3, 0, 1, 4]), _ORDER),
            ),
        ),
        Group(
            "head_looks_out_of_the_face",
            "unit vectors in which the faces look, in the photo's camera frame",
            "head",
            "",
            (
                Reading("into the face", times(-1, -1, -1), "(0, 0, -1) looks at the camera."),
                Reading("with x to the left", times(-1, 1, 1), "x points right, y down."),
                Reading("with y up", times(1, -1, 1), "x points right, y down."),
                Reading("with z to the camera", times(1, 1, -1), "z points away from the camera."),
            ),
        ),
    ),
)
