"""How outputs of a PersonObserver are compared: what people do and touch, where the faces look, and
the sides in a mirrored photo.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.body import angle_deg
from physic_core.types import CHOICES, PROBABILITIES, SIDES, TOUCH_PARTS, mirrored_order
from physic_testing.conformance import truth as worlds
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.output_checks import COLOURS, ROWS, WITHOUT_PEOPLE
from physic_testing.conformance.readings import (
    MIN_UNITS,
    Group,
    Reading,
    Table,
    expect_within_sigmas,
    reordered,
    times,
    values_of,
)

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Observations
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case, Truth, Values

MIRROR_TOLERANCE = 0.1
"""Difference of probabilities that may be an error."""

MAX_BRIER = {"posture": 0.45, "other": 0.6}
"""Mean squared error of probabilities from which on they mislead: of 0.5 for all it is 0.25. People
of worlds have no faces: the embedded observer has up to 0.33 and 0.51.
"""

ALIKE = 0.05
MAX_OF_ALIKE = 0.3
"""Range of probabilities that are the same of everybody, and the most of these: they are evidence
of nothing.
"""

_OWN_LEFT = "Are sides those of the picture? Left is the person's own."
_ORDER = "The order is that of physic_core.types.TOUCH_PARTS."
_ANSWERS = "The order of the answers is that of physic_core.types.TOUCHED."


def _values(answer: Observations, case: Case) -> tuple[Values, Truth]:
    """Return touch, faces, and what each probability is evidence of, (N, n) in [0, 1]."""
    world = case.truth
    touch = worlds.true_touch(world).astype(float)
    truth = {
        "posture": worlds.true_posture(world),
        "touch": touch,
        "on_floor": np.where(touch[:, :2, 0] > 0, worlds.true_feet_on_floor(world), np.nan),
        "child": worlds.true_child(world),
        "away": worlds.true_away(world),
        "head": worlds.true_head(world),
    }
    own: Values = {"head": answer.head.astype(float), "sigma": answer.head_sigma}
    for name in PROBABILITIES:
        own[name] = value = np.asarray(getattr(answer, name), float)
        share = np.asarray(getattr(answer, f"{name}_share"), float)
        own[f"evidence of {name}"] = _without_share(name, value, share)
    return own, truth


def _without_share(name: str, probability: FloatArray, share: FloatArray) -> FloatArray:
    """Return probabilities of data in which each answer is equally frequent."""
    if name in CHOICES:
        odds = probability / np.maximum(share, 1e-4)
        return np.asarray(odds / odds.sum(-1, keepdims=True))
    yes, no = probability / np.maximum(share, 1e-4), (1 - probability) / np.maximum(1 - share, 1e-4)
    return np.asarray(yes / (yes + no))


def check_probabilities_agree_with_the_worlds(subject: BackendUnderTest) -> None:
    """Without their shares, probabilities do not mislead; those that are the same of everybody are
    evidence of nothing.
    """
    evidence = values_of(subject, _values)
    for name in PROBABILITIES:
        own = np.concatenate([values[f"evidence of {name}"].ravel() for values, _ in evidence])
        true = np.concatenate([np.ravel(truth[name]).astype(float) for _, truth in evidence])
        off = [(own - t)[(true == t) & np.isfinite(own)] ** 2 for t in (0.0, 1.0)]
        every = np.concatenate(off)
        same = np.ptp(own[np.isfinite(own)]) < ALIKE if every.size else False
        means = [every.mean()] if same else [part.mean() for part in off if len(part) >= MIN_UNITS]
        limit = MAX_OF_ALIKE if same else MAX_BRIER.get(name, MAX_BRIER["other"])
        error = float(np.mean(means or [0]))
        expect(
            error < limit,
            f"`{name}`, without `{name}_share`, of what people do",
            f"a mean squared error of {error:.2f}, of 0.5 it is 0.25",
            "Is it inverted, in another order, or the same of everybody but not the share?",
        )


def check_stated_error_of_faces_holds(subject: BackendUnderTest) -> None:
    """The angle between ``head`` and where faces look is plausible for ``head_sigma``."""
    apart = [
        float(angle_deg(head, true)) / float(sigma)
        for values, truth in values_of(subject, _values)
        for head, true, sigma in zip(values["head"], truth["head"], values["sigma"], strict=True)
        if np.isfinite(head).all()
    ]
    if not apart:
        raise CheckSkipped("of nobody it tells where the face looks")
    expect_within_sigmas(apart, "directions of faces", "Is head_sigma in degrees?")


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
    """Return what is said of the left and the right side (N, 2, 20), in [0, 1]."""
    rows = [[i for i, part in enumerate(TOUCH_PARTS) if part.startswith(side)] for side in SIDES]
    both = answer.touch[:, rows].astype(np.float64)
    return both.reshape(len(both), 2, -1)


TABLE = Table(
    _values,
    (
        WITHOUT_PEOPLE,
        Check(check_mirrored_photo_exchanges_sides, unless=BLIND),
        Check(
            check_probabilities_agree_with_the_worlds,
            after=("touch_is_that_of_the_parts",),
            unless=BLIND,
        ),
        Check(
            check_stated_error_of_faces_holds,
            after=("head_looks_out_of_the_face",),
            unless=BLIND,
        ),
        *ROWS,
        COLOURS,
    ),
    (
        Group(
            "touch_is_that_of_the_parts",
            "probabilities of what each part touches, left ones on the person's own left",
            "touch",
            "of a probability",
            (
                Reading("inverted", lambda p, _: (1 - p) / 4, "1 is touch."),
                Reading(
                    "with left and right exchanged",
                    reordered(mirrored_order(TOUCH_PARTS)),
                    _OWN_LEFT,
                ),
                Reading("with hands for feet", reordered([2, 3, 0, 1, *range(4, 10)]), _ORDER),
                Reading(
                    "with answers in another order", reordered([4, 0, 1, 2, 3], axis=2), _ANSWERS
                ),
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
