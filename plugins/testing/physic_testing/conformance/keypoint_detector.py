"""How outputs of a KeypointDetector are compared: places of joints, their order, and their
confidence.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.body import JOINT_INDEX
from physic_core.errors import BodyModelError
from physic_core.types import SIDES, SKELETONS, Skeleton, mirrored_order
from physic_testing.conformance.cases import Truth, Values
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import expect
from physic_testing.conformance.known_mistakes import (
    Group,
    KnownMistake,
    Table,
    normalised,
    plus,
    search_order,
    times,
)
from physic_testing.conformance.output_checks import COLOURS, ROWS, WITHOUT_PEOPLE
from physic_testing.conformance.truth import comparable_keypoints

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Keypoints
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case

MIN_JOINTS = 5
"""Joints in sight without which a person is not compared."""

_IN_WORLD = tuple(f"{side}_{name}" for side in SIDES for name in ("shoulder", "elbow", "ankle"))

_ASPECT = (
    "Is the crop that is scaled back the one that the network saw, with its margin and its "
    "aspect ratio?"
)


def _values(answer: Keypoints, case: Case) -> tuple[Values, Truth]:
    """Return points from the centres of the boxes, px, NaN where hidden or not detected, and
    confidences of the joints that are on a body; points in the world of joints of the body, from
    their mean.
    """
    keypoints, true, visible = comparable_keypoints(answer, case.truth)
    is_answered = visible & (keypoints.confidence > 0)
    counted = visible & (visible.sum(axis=1, keepdims=True) > MIN_JOINTS)
    points, true = (
        np.where(is_known[..., None], positions - _centres(case), np.nan)
        for is_known, positions in ((is_answered, keypoints.points), (counted, true))
    )
    names = answer.joint_set.names
    in_world = np.full((len(points), len(_IN_WORLD), 3), np.nan)
    if answer.world is not None and {*_IN_WORLD} <= {*names}:
        in_world = answer.world[:, [names.index(name) for name in _IN_WORLD]].astype(float)
    joints = case.truth.joints[:, [JOINT_INDEX[name] for name in _IN_WORLD]]
    values = {"points": points, "confidence": keypoints.confidence, "world": _from_mean(in_world)}
    truth = {"points": true, "confidence": visible.astype(float), "world": _from_mean(joints)}
    return values, truth | {"names": keypoints.joint_set.names}


def _from_mean(points: FloatArray) -> FloatArray:
    return np.asarray(points - points.mean(axis=1, keepdims=True))


def _errors(values: Values, truth: Truth) -> dict[str, Any]:
    apart = np.linalg.norm(values["points"] - truth["points"], axis=2)
    return {"share of person": apart / truth["case"].box_sides[:, None]}


def _centres(case: Case) -> FloatArray:
    """Return the centres (N, 1, 2) of the boxes, px."""
    boxes = case.people.boxes[:, None]
    return (boxes[..., :2] + boxes[..., 2:] - 1) / 2


def _in_boxes(points: FloatArray, truth: Truth) -> list[FloatArray]:
    """Return the points of each person, in sides of the box."""
    return list((points / truth["case"].box_sides[:, None, None]).reshape(len(points), -1))


def _mirrored(points: FloatArray, truth: Truth) -> FloatArray:
    middle = (truth["case"].photo.shape[1] - 1) / 2
    moved = 2 * ([middle, 0] - _centres(truth["case"])) * [1, 0]
    return np.asarray(points * [-1, 1] + moved)


def _other_sides(points: FloatArray, truth: Truth) -> FloatArray:
    return points[:, mirrored_order(truth["names"])]


def _clipped(points: FloatArray, truth: Truth) -> FloatArray:
    boxes = truth["case"].people.boxes[:, None]
    half = (boxes[..., 2:] - boxes[..., :2] - 1) / 2
    return np.clip(points, -half, half)


def _distorted(points: FloatArray, truth: Truth) -> FloatArray:
    camera = truth["case"].intrinsics
    beside = points + _centres(truth["case"]) - [camera.cx, camera.cy]
    farther = 0.05 * ((beside / camera.fx) ** 2).sum(axis=-1, keepdims=True)
    return np.asarray(points + farther * beside)


def check_skeleton_is_known(subject: BackendUnderTest) -> None:
    """`skeleton` is a standard name or a Skeleton on the body, with one point per joint."""
    from physic_core.body import load_body

    answer = subject.result()
    expect(
        isinstance(answer.skeleton, Skeleton) or answer.skeleton in SKELETONS,
        f"a Skeleton, or the name of a standard one: "
        f"{', '.join(n for n in SKELETONS if 'hand' not in n)}",
        f"{answer.skeleton!r}",
    )
    skeleton = answer.joint_set
    try:
        load_body("embedded").regressor(skeleton.take(skeleton.fitted))
    except BodyModelError as error:
        expect(False, "points that lie on a body", str(error))
    count = answer.points.shape[1]
    expect(count == len(skeleton), f"{len(skeleton)} joints of {skeleton.name!r}", f"{count}")


_BACK = "For a mirrored photo, are points and left/right names mirrored back?"
_CROP = "Are points clipped to the crop?"

_OTHER = (
    KnownMistake("mirrored", _mirrored, _BACK),
    KnownMistake("with left and right exchanged", _other_sides, _BACK),
    KnownMistake(
        "a mean of left and right, as of a mirrored photo",
        lambda points, truth: (points + _other_sides(points, truth)) / 2,
        _BACK,
    ),
    KnownMistake("clipped to the box of the person", _clipped, _CROP),
    KnownMistake("a third wider than the person", times(4 / 3, 1), _ASPECT),
)

_PIXEL = "Is half a pixel of a crop or a heat map lost, or are coordinates rounded down?"

_GRID = (
    f"{_ASPECT} A grid of N cells between the borders has a step of size / N, between corners "
    f"of size / (N - 1)."
)

_ONE_ORDER = "Points and confidences need one order of joints."
_LENS = "Is the lens distortion undone?"

_ALONG = (
    KnownMistake("to the right", plus(0.5, 0), _PIXEL, 0.5, " px", 0.3),
    KnownMistake("down", plus(0, 0.5), _PIXEL, 0.5, " px", 0.3),
    KnownMistake("too large along x", times(1.05, 1), _GRID, 5, " %", 3),
    KnownMistake("too large along y", times(1, 1.05), _GRID, 5, " %", 3),
    KnownMistake("distorted as by a lens of k1", _distorted, _LENS, 0.05, "", 0.015),
)

TABLE = Table(
    _values,
    _errors,
    (
        WITHOUT_PEOPLE,
        Check(check_skeleton_is_known),
        *ROWS,
        COLOURS,
    ),
    (
        Group(
            "joints_are_those_of_the_person",
            "points x, y in px of the photo of the stated joints, left ones on the person's own "
            "left",
            "points",
            "sides of the box",
            _OTHER,
            _in_boxes,
            rough=0.25,
            search=search_order((), 1),
        ),
        Group(
            "joints_are_not_shifted_or_scaled",
            "joints without a common shift or scale; integer coordinates are pixel centers",
            "points",
            "px",
            _ALONG,
            after=("joints_are_those_of_the_person", "reads_images_as_rgb"),
        ),
        Group(
            "confidence_tells_hidden_joints",
            "a higher confidence of visible joints than of hidden ones, joint by joint",
            "confidence",
            "of a unit vector",
            (
                KnownMistake("inverted", lambda rows, _: 1 - rows, "1 is sure."),
                KnownMistake(
                    "of the joint before", lambda rows, _: np.roll(rows, 1, 1), _ONE_ORDER
                ),
                KnownMistake("of the next joint", lambda rows, _: np.roll(rows, -1, 1), _ONE_ORDER),
                KnownMistake("of the other side", _other_sides, _ONE_ORDER),
            ),
            normalised,
            is_telling=True,
        ),
        Group(
            "world_points_are_metres",
            "`world` in meters, x right and y down",
            "world",
            "m",
            (
                KnownMistake("with x to the left", times(-1, 1, 1), "x points right in the photo."),
                KnownMistake("with y up", times(1, -1, 1), "y points down."),
                KnownMistake("too large", times(2), "Is it in meters?", 100, " %", 40),
            ),
            rough=0.5,
            after=("joints_are_those_of_the_person",),
        ),
    ),
    after=("skeleton_is_known",),
)
