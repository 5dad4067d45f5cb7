"""How outputs of a KeypointDetector are compared: places of joints, their order, and their
confidence.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import BodyModelError
from physic_core.interfaces.comparison import is_sigmoid_of_probability
from physic_core.types import SKELETONS, Skeleton, mirrored_order
from physic_testing.conformance.cases import Truth, Values
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.output_checks import COLOURS, ROWS, WITHOUT_PEOPLE
from physic_testing.conformance.readings import (
    MIN_UNITS,
    Group,
    Reading,
    Table,
    plus,
    shares,
    times,
    values_of,
)
from physic_testing.conformance.truth import comparable_keypoints

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Keypoints
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case

MIN_JOINTS = 5
"""Joints in sight without which a person is not compared."""

_ASPECT = (
    "Is the crop that is scaled back the one that the network saw, with its margin and its "
    "aspect ratio?"
)


def _values(answer: Keypoints, case: Case) -> tuple[Values, Truth]:
    """Return points from the centres of the boxes, px, NaN where hidden or not detected, and
    confidences of the joints that are on a body.
    """
    found, true, visible = comparable_keypoints(answer, case.truth)
    shown = visible & (found.confidence > 0)
    points = np.where(shown[..., None], found.points - _centres(case), np.nan)
    true = np.where(visible[..., None], true - _centres(case), np.nan)
    true[visible.sum(axis=1) <= MIN_JOINTS] = np.nan
    names = found.joint_set.names
    truth = {"points": true, "confidence": visible.astype(float), "names": names}
    return {"points": points, "confidence": found.confidence}, truth


def _centres(case: Case) -> FloatArray:
    """Return the centres (N, 1, 2) of the boxes, px."""
    centres: FloatArray = ((case.people.boxes[:, :2] + case.people.boxes[:, 2:]) / 2 - 0.5)[:, None]
    return centres


def _in_boxes(points: FloatArray, truth: Truth) -> list[FloatArray]:
    """Return the points of each person, in sides of the box."""
    sides = truth["case"].box_sides
    return [person.ravel() / side for person, side in zip(points, sides, strict=True)]


def _mirrored(points: FloatArray, truth: Truth) -> FloatArray:
    centres = _centres(truth["case"])
    width = truth["case"].photo.shape[1]
    mirrored: FloatArray = [width - 1, 0] - (points + centres) * [1, -1] - centres
    return mirrored


def _other_sides(points: FloatArray, truth: Truth) -> FloatArray:
    return points[:, mirrored_order(truth["names"])]


def _mean_of_sides(points: FloatArray, truth: Truth) -> FloatArray:
    return (points + _other_sides(points, truth)) / 2


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


def check_confidence_tells_hidden_joints(subject: BackendUnderTest) -> None:
    """Joints in sight have no lower mean confidence than hidden ones, and confidences are those of
    their joints.
    """
    evidence = values_of(subject, _values)
    own = [values["confidence"] for values, _ in evidence]
    true = [truth["confidence"] for _, truth in evidence]
    every = np.concatenate([confidence.ravel() for confidence in own])
    wanted = "confidences that tell joints in sight from hidden ones"
    hint = "Return the height of the heat map's maximum, or what the network says of it."
    expect(float(every.std()) > 1e-6, wanted, f"{every[0]:.2f} for all joints in all photos", hint)
    got = f"{every.min():.2f} to {every.max():.2f} in all photos"
    expect(not is_sigmoid_of_probability(every), wanted, got, "Is a sigmoid applied twice?")
    sides = mirrored_order(evidence[0][1]["names"])
    others = {
        "inverted": [1 - rows for rows in true],
        "of the joint before": [np.roll(rows, 1, axis=1) for rows in true],
        "of the next joint": [np.roll(rows, -1, axis=1) for rows in true],
        "of the other side": [rows[:, sides] for rows in true],
        "of people in reverse order": [rows[::-1] for rows in true],
    }
    off = _centred_rows(own, true)
    for words, rows in others.items():
        share = shares(off, _centred_rows(rows, true))
        share = share[np.isfinite(share)]
        expect(
            len(share) < MIN_UNITS or float(np.median(share)) <= 0.5,
            "a higher confidence of joints in sight",
            f"confidences that are better if they are {words}",
            "1 is sure. Points and confidences need one order of joints and people.",
        )


def _centred_rows(own: list[FloatArray], true: list[FloatArray]) -> list[FloatArray]:
    """Return the difference of the confidences of each person from the truth, both of mean 0 and
    length 1; NaN where one of them is constant or too few joints are in sight, or hidden.
    """
    found = []
    for row, shown in zip(np.concatenate(own), np.concatenate(true), strict=True):
        one, other = (side - side.mean() for side in (row, shown))
        is_known = min(one.std(), other.std()) > 1e-6
        if is_known and min(shown.sum(), (1 - shown).sum()) >= MIN_UNITS:
            found.append(one / np.linalg.norm(one) - other / np.linalg.norm(other))
        else:
            found.append(np.full(len(row), np.nan))
    return found


def check_world_points_are_metres(subject: BackendUnderTest) -> None:
    """`world`, if given, is in metres with y down: a standing person's nose is above the ankles."""
    answer = subject.result()
    names = answer.joint_set.names
    if answer.world is None or not {"nose", "left_ankle", "right_ankle"} <= set(names):
        raise CheckSkipped("it returns no world points")
    nose, *ankles = (names.index(name) for name in ("nose", "left_ankle", "right_ankle"))
    height = answer.world[:, ankles, 1].mean(axis=1) - answer.world[:, nose, 1]
    expect(
        bool(((height > 0.5) & (height < 3)).all()),
        "metres, y down: 0.5-3 m from nose to ankles of a standing person",
        f"{np.round(height, 2).tolist()}",
    )
    slopes = [
        np.polyfit(points[seen, 0], world[seen, 0], 1)[0]
        for points, world, seen in zip(
            answer.points, answer.world, answer.confidence > 0, strict=True
        )
        if seen.sum() > MIN_JOINTS
    ]
    expect(
        min(slopes, default=1) > 0,
        "x of the world points to the right, as in the photo",
        "x to the left",
    )


_BACK = "Was the output for a mirrored photo mirrored back, points and names?"
_CROP = "Are points clipped to the crop?"

_OTHER = (
    Reading("mirrored", _mirrored, _BACK),
    Reading("with left and right exchanged", _other_sides, _BACK),
    Reading("a mean of left and right, as of a mirrored photo", _mean_of_sides, _BACK),
    Reading("clipped to the box of the person", _clipped, _CROP),
    Reading("a third wider than the person", times(4 / 3, 1), _ASPECT),
)

_PIXEL = "Is half a pixel of a crop or a heat map lost, or are coordinates rounded down?"

_GRID = (
    f"{_ASPECT} A grid of N cells between the borders has a step of size / N, between corners "
    f"of size / (N - 1)."
)

_LENS = "Is the lens distortion undone?"

_ALONG = (
    Reading("to the right", plus(0.5, 0), _PIXEL, 0.5, " px", 0.3),
    Reading("down", plus(0, 0.5), _PIXEL, 0.5, " px", 0.3),
    Reading("too large along x", times(1.05, 1), _GRID, 5, " %", 3),
    Reading("too large along y", times(1, 1.05), _GRID, 5, " %", 3),
    Reading("distorted as by a lens of k1", _distorted, _LENS, 0.05, "", 0.015),
)

TABLE = Table(
    _values,
    (
        WITHOUT_PEOPLE,
        Check(check_skeleton_is_known),
        Check(check_confidence_tells_hidden_joints, after=("skeleton_is_known",), unless=BLIND),
        Check(
            check_world_points_are_metres,
            after=("skeleton_is_known", "joints_are_those_of_the_person"),
        ),
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
            order=((), 1),
        ),
        Group(
            "joints_are_not_shifted_or_scaled",
            "joints without a common shift or scale; integer coordinates are pixel centres",
            "points",
            "px",
            _ALONG,
            after=("joints_are_those_of_the_person", "reads_images_as_rgb"),
        ),
    ),
    after=("skeleton_is_known",),
)
