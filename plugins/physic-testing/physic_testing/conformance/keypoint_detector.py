"""How outputs of a KeypointDetector are compared: places of joints, their order, and their
confidence.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import BodyModelError
from physic_core.types import SKELETONS, Skeleton
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.output_checks import PEOPLE_CHECKS, ROW_CHECKS
from physic_testing.conformance.readings import (
    MIN_UNITS,
    Group,
    Make,
    Reading,
    Table,
    Values,
    shares,
    values_of,
)
from physic_testing.conformance.truth import comparable_keypoints, mirrored_order

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Keypoints
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case

MIN_JOINTS = 5
"""Joints in sight without which a person is not compared."""


def _values(answer: Keypoints, case: Case, truth: Values) -> Values:
    """Return points, NaN where hidden or not detected, and confidences of the joints that are on a
    body.
    """
    from physic_core.body.landmarks import keypoints_on_body

    known = keypoints_on_body(answer)
    shown = (known.confidence > 0) & np.isfinite(truth["points"][..., 0])
    points = np.where(shown[..., None], known.points, np.nan)
    return {"points": points, "confidence": known.confidence, "names": known.joint_set.names}


def _truth(answer: Keypoints, case: Case) -> Values:
    _, true, _, skeleton = comparable_keypoints(answer, case.truth)
    from physic_testing.conformance.true_keypoints import world_keypoints

    seen = world_keypoints(case.truth, skeleton)[1]
    points = np.where(seen[..., None], true, np.nan)
    return {"points": points, "confidence": np.where(seen, 1.0, 0.0), "names": skeleton.names}


def _sides(case: Case) -> FloatArray:
    """Return the larger side of each person's box (N,), px."""
    sides: FloatArray = (case.people.boxes[:, 2:] - case.people.boxes[:, :2]).max(axis=1)
    return sides


def _centres(case: Case) -> FloatArray:
    """Return the centres (N, 1, 2) of the boxes, px."""
    centres: FloatArray = ((case.people.boxes[:, :2] + case.people.boxes[:, 2:]) / 2 - 0.5)[:, None]
    return centres


def _in_boxes(values: Values, truth: Values, case: Case) -> list[FloatArray]:
    """Return the points of each person, in sides of the box."""
    flat = (values["points"] - _centres(case)) / _sides(case)[:, None, None]
    enough = np.isfinite(truth["points"][..., 0]).sum(axis=1) > MIN_JOINTS
    return [
        np.where(kept, person, np.nan).ravel() for person, kept in zip(flat, enough, strict=True)
    ]


def _in_px(values: Values, truth: Values, case: Case) -> list[FloatArray]:
    """Return the points of each person, px."""
    sides = _sides(case)
    return [unit * side for unit, side in zip(_in_boxes(values, truth, case), sides, strict=True)]


def _points(change: Callable[[FloatArray, FloatArray], FloatArray]) -> Make:
    return lambda values, case: values | {"points": change(values["points"], _centres(case))}


def _distorted(values: Values, case: Case) -> Values:
    beside = values["points"] - [case.intrinsics.cx, case.intrinsics.cy]
    stretch = 1 + 0.05 * ((beside / case.intrinsics.fx) ** 2).sum(axis=-1, keepdims=True)
    return values | {"points": values["points"] + (stretch - 1) * beside}


def _other_sides(values: Values, case: Case) -> Values:
    return values | {"points": values["points"][:, mirrored_order(values["names"])]}


def _clipped(values: Values, case: Case) -> Values:
    boxes = case.people.boxes[:, None]
    return values | {"points": np.clip(values["points"], boxes[..., :2], boxes[..., 2:] - 1)}


def _mean_of_sides(values: Values, case: Case) -> Values:
    return values | {"points": (values["points"] + _other_sides(values, case)["points"]) / 2}


_BACK = "Was the output for a mirrored photo mirrored back, points and names?"
_PIXEL = "Is half a pixel of a crop or a heat map lost, or are coordinates rounded down?"
_ASPECT = (
    "Is the crop that is scaled back the one that the network saw, with its margin and its "
    "aspect ratio?"
)
_GRID = (
    f"{_ASPECT} A grid of N cells between the borders has a step of size / N, between corners "
    f"of size / (N - 1)."
)
_READINGS = (
    Reading(
        "mirrored",
        lambda v, case: v | {"points": [case.photo.shape[1] - 1, 0] - v["points"] * [1, -1]},
        _BACK,
    ),
    Reading("with left and right exchanged", _other_sides, _BACK),
    Reading("a mean of left and right, as of a mirrored photo", _mean_of_sides, _BACK),
    Reading("clipped to the box of the person", _clipped, "Are points clipped to the crop?"),
    Reading(
        "a third wider than the person", _points(lambda p, c: c + (p - c) * [4 / 3, 1]), _ASPECT
    ),
)
_X = np.array([1.0, 0])
_Y = np.array([0, 1.0])
_ALONG = (
    Reading("to the right", _points(lambda p, _: p + 0.5 * _X), _PIXEL, 0.5, " px", 0.3),
    Reading("down", _points(lambda p, _: p + 0.5 * _Y), _PIXEL, 0.5, " px", 0.3),
    Reading(
        "too large along x", _points(lambda p, c: p + 0.05 * (p - c) * _X), _GRID, 5.0, " %", 3.0
    ),
    Reading(
        "too large along y", _points(lambda p, c: p + 0.05 * (p - c) * _Y), _GRID, 5.0, " %", 3.0
    ),
    Reading(
        "distorted as by a lens of k1",
        _distorted,
        "Is the lens distortion undone?",
        0.05,
        "",
        0.015,
    ),
)
_OWN = "joints_are_those_of_the_person"
_KNOWN = ("skeleton_is_known",)
TABLE = Table(
    _values,
    _truth,
    (
        Group(
            _OWN,
            "points x, y in px of the photo of the stated joints, left ones on the person's own "
            "left",
            "sides of the box",
            _in_boxes,
            _READINGS,
            rough=0.25,
            order=("points", (), 1),
        ),
        Group(
            "joints_are_not_shifted_or_scaled",
            "joints without a common shift or scale; integer coordinates are pixel centres",
            "px",
            _in_px,
            _ALONG,
            after=(_OWN, "reads_images_as_rgb"),
        ),
    ),
    "physic_core.types.Keypoints",
    _KNOWN,
)


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
    evidence = values_of(subject, TABLE)
    every = np.concatenate([values["confidence"].ravel() for _, values, _ in evidence])
    wanted = "confidences that tell joints in sight from hidden ones"
    hint = "Return the height of the heat map's maximum, or what the network says of it."
    expect(float(every.std()) > 1e-6, wanted, f"{every[0]:.2f} for all joints in all photos", hint)
    low = float(every.min())
    high = float(every.max())
    is_narrow = low >= 0.5 and high <= 1 / (1 + np.exp(-1.0)) + 1e-3
    expect(
        not is_narrow,
        wanted,
        f"{low:.2f} to {high:.2f} in all photos",
        "Is a sigmoid applied twice?",
    )
    own = [values["confidence"] for _, values, _ in evidence]
    true = [truth["confidence"] for _, _, truth in evidence]
    sides = mirrored_order(evidence[0][2]["names"])
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
    length 1.
    """
    found = []
    for rows, seen in zip(own, true, strict=True):
        for row, shown in zip(rows, seen, strict=True):
            one = row - row.mean()
            other = shown - shown.mean()
            if (
                min(one.std(), other.std()) > 1e-6
                and min(shown.sum(), (1 - shown).sum()) >= MIN_UNITS
            ):
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
    height = answer.world[:, [names.index("left_ankle"), names.index("right_ankle")], 1].mean(
        axis=1
    )
    height = height - answer.world[:, names.index("nose"), 1]
    expect(
        bool(((height > 0.5) & (height < 3)).all()),
        "metres, y down: 0.5-3 m from nose to ankles of a standing person",
        f"{np.round(height, 2).tolist()}",
    )
    flat = answer.points[..., 0]
    seen = answer.confidence > 0
    slopes = [
        np.polyfit(flat[i, s], answer.world[i, s, 0], 1)[0]
        for i, s in enumerate(seen)
        if s.sum() > MIN_JOINTS
    ]
    expect(
        min(slopes, default=1) > 0,
        "x of the world points to the right, as in the photo",
        "x to the left",
    )


CHECKS: tuple[Check, ...] = (
    *PEOPLE_CHECKS,
    Check(check_skeleton_is_known, TABLE.read),
    Check(check_confidence_tells_hidden_joints, TABLE.read, after=_KNOWN, unless=BLIND),
    Check(
        check_world_points_are_metres, TABLE.read, after=(*_KNOWN, "joints_are_those_of_the_person")
    ),
    *ROW_CHECKS,
)
"""Further checks of a KeypointDetector, in order of execution."""
