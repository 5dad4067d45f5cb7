"""Checks of a KeypointDetector: known skeleton, pixel coordinates and left-right order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import BodyModelError
from physic_core.types import SKELETONS, Skeleton
from physic_testing.conformance.bias import expect_no_better, expect_no_bias, expect_order, mean_and_margin
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.output_checks import PEOPLE_CHECKS
from physic_testing.conformance.row_order import check_rows_follow_the_people
from physic_testing.conformance.truth import comparable_keypoints, mirrored_order

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Keypoints
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case

MAX_ERROR = 0.25
"""Maximum median error as a share of the larger side of the person's box."""

MAX_SHIFT_PX, MAX_SCALE = 0.3, 0.03
"""Mean shift and mean relative error of scale that are treated as zero.

Networks place joints by their annotations: BlazePose's ankles lie 2 to 4 % of the box below those of the body, which is
a scale of 2.6 % along y.
"""

MAX_CONFIDENCE = 0.01
"""Mean confidence by which hidden joints may be surer."""

MUCH_CLEARER = 0.6
"""As of ``expect_no_better``: another order leaves a quarter of the wrong pairs."""

MAX_GRID = 0.1
"""Error of scale that a grid of cells explains; larger ones come from a crop."""

_GRID = "A grid of N cells between the borders has a step of size / N, between corners of size / (N - 1)."
_ASPECT = "Is the crop that is scaled back the one that the network saw, with its margin and its aspect ratio?"

MIN_JOINTS = 5
"""Joints in sight without which a person has no line of errors over places."""


def check_skeleton_is_known(subject: BackendUnderTest) -> None:
    """`skeleton` is a standard name or a Skeleton on the body, with one point per joint."""
    from physic_core.body import load_body

    answer = subject.result()
    expect(
        isinstance(answer.skeleton, Skeleton) or answer.skeleton in SKELETONS,
        f"a Skeleton, or the name of a standard one: {', '.join(n for n in SKELETONS if 'hand' not in n)}",
        f"{answer.skeleton!r}",
    )
    skeleton = answer.joint_set
    try:
        load_body("embedded").regressor(skeleton.take(skeleton.fitted))
    except BodyModelError as error:
        expect(False, "points that lie on a body", str(error))
    count = answer.points.shape[1]
    expect(count == len(skeleton), f"{len(skeleton)} joints of {skeleton.name!r}", f"{count}")


def check_joints_lie_on_the_person(subject: BackendUnderTest) -> None:
    """Visible joints are close to the true joints, in px of the photo."""
    answer, truth = subject.result(), subject.case("one person").truth
    points, true, seen, _ = comparable_keypoints(answer, truth)
    if not seen.any():
        raise CheckSkipped("no visible joint has a confidence above 0")
    sides = (truth.boxes[:, 2:] - truth.boxes[:, :2]).max(axis=1)[:, None]
    error = float(np.median((np.linalg.norm(points - true, axis=2) / sides)[seen]))
    turned = float(np.median((np.linalg.norm(points[..., ::-1] - true, axis=2) / sides)[seen]))
    hint = "The order is x, y." if turned < MAX_ERROR else "Are they in px of a crop, or shares of the size?"
    expect(
        error < MAX_ERROR,
        f"points x, y in px of the photo, with a median error below {MAX_ERROR:.0%} of the person's box",
        f"{error:.0%}; joint 0 at {np.round(points[0, 0], 2).tolist()} px, truly {np.round(true[0, 0], 1).tolist()}",
        hint,
    )


def check_joints_are_in_order(subject: BackendUnderTest) -> None:
    """No joints are exchanged: none has the places of another, such as its left-right counterpart."""
    found = [_normalised(answer, case) for case, answer in subject.evidence()]
    skeleton = found[0][3]
    apart = np.concatenate(
        [
            np.where(
                seen[:, :, None] & seen[:, None], np.linalg.norm(points[:, :, None] - true[:, None], axis=3), np.nan
            )
            for points, true, seen, _ in found
        ]
    )
    expect_order(
        apart,
        skeleton.names,
        0.001,
        f"the joints of {skeleton.name!r} in order, left ones on the person's own left, mean error in sides of the box",
        "Is it the order of another data set, or was the output of a mirrored photo not mirrored back?",
    )


def check_joints_are_not_shifted_or_scaled(subject: BackendUnderTest) -> None:
    """The mean shift of the joints is below 0.3 px, and their mean scale about the box's centre right to 3 %."""
    fits, sizes, residuals, places = [], [], [], []
    for case, answer in subject.evidence():
        points, true, seen, _ = _normalised(answer, case)
        size = _sides(case)
        for i, kept in enumerate(seen):
            if kept.sum() > MIN_JOINTS:
                fits.append([_line(true[i, kept, axis], (points - true)[i, kept, axis]) for axis in (0, 1)])
                sizes.append(size[i])
        residuals.append(np.where(seen[..., None], points - true, np.nan))
        places.append(np.where(seen[..., None], true, np.nan))
    if not fits:
        raise CheckSkipped(f"no person shows more than {MIN_JOINTS} joints")
    lines, px = np.array(fits), np.array(sizes)
    common, where = _means(np.concatenate(residuals)), _means(np.concatenate(places))
    for axis, way in enumerate("xy"):
        shift_error, scale_error = _line_errors(where[:, axis], common[:, axis])
        expect_no_bias(
            lines[:, axis, 0] * px,
            MAX_SHIFT_PX,
            f"joints without a common shift along {way}; integer coordinates are pixel centres",
            " px",
            "Is half a pixel of a crop or a heat map lost, or are coordinates rounded down?",
            further=shift_error * float(px.mean()),
        )
        expect_no_bias(
            100 * lines[:, axis, 1],
            100 * MAX_SCALE,
            f"joints of the right scale along {way} about the centre of the person's box",
            " %",
            _ASPECT if abs(lines[:, axis, 1].mean()) > MAX_GRID else _GRID,
            further=100 * scale_error,
        )


def check_confidence_is_higher_in_sight(subject: BackendUnderTest) -> None:
    """Joints in sight have no lower mean confidence than hidden ones."""
    from physic_core.body.landmarks import keypoints_on_body
    from physic_testing.conformance.true_keypoints import world_keypoints

    more = []
    every = np.concatenate([answer.confidence.ravel() for _, answer in subject.evidence()])
    expect(
        float(every.std()) > 1e-6,
        "confidences that tell joints in sight from hidden ones",
        f"{every[0]:.2f} for all joints in all photos",
        "Return the height of the heat map's maximum, or what the network says of it.",
    )
    for case, answer in subject.evidence():
        known = keypoints_on_body(answer)
        seen = world_keypoints(case.truth, known.joint_set)[1]
        more += [
            c[s].mean() - c[~s].mean() for c, s in zip(known.confidence, seen, strict=True) if 0 < s.sum() < len(s)
        ]
    mean, margin = mean_and_margin(np.array(more))
    expect(
        mean + margin > -MAX_CONFIDENCE,
        "a higher confidence of joints in sight",
        f"{mean:+.2f} in the mean",
        "1 is sure.",
    )
    _expect_confidence_of_own_joints(subject)


def _expect_confidence_of_own_joints(subject: BackendUnderTest) -> None:
    """Raise CheckFailed if confidences tell hidden joints better when they are those of other joints or people."""
    from physic_core.body.landmarks import keypoints_on_body
    from physic_testing.conformance.true_keypoints import world_keypoints

    own: list[float] = []
    others: dict[str, list[float]] = {}
    for case, answer in subject.evidence():
        known = keypoints_on_body(answer)
        seen, sides = world_keypoints(case.truth, known.joint_set)[1], mirrored_order(known.joint_set.names)
        readings = {
            "of the joint before": np.roll(known.confidence, 1, axis=1),
            "of the next joint": np.roll(known.confidence, -1, axis=1),
            "of the other side": known.confidence[:, sides],
            "of people in reverse order": known.confidence[::-1],
        }
        own += _ranking_errors(known.confidence, seen)
        for words, read in readings.items():
            others.setdefault(words, []).extend(_ranking_errors(read, seen))
    expect_no_better(
        np.array(own),
        {words: np.array(errors) for words, errors in others.items()},
        0.01,
        "the confidence of each joint of each person, share of pairs of joints in wrong order",
        dict.fromkeys(others, "Points and confidences need the same order of joints and people."),
        clearly=MUCH_CLEARER,
    )


def _ranking_errors(confidence: FloatArray, seen: BoolArray) -> list[float]:
    """Return for each person the share of pairs whose hidden joint is surer; NaN without hidden joints."""
    found = []
    for values, shown in zip(confidence, seen, strict=True):
        gaps = values[shown][:, None] - values[~shown]
        found.append(float((gaps < 0).mean() + 0.5 * (gaps == 0).mean()) if gaps.size else float("nan"))
    return found


def check_world_points_are_metres(subject: BackendUnderTest) -> None:
    """`world`, if given, is in metres with y down: a standing person's nose is above the ankles."""
    answer = subject.result()
    names = answer.joint_set.names
    if answer.world is None or not {"nose", "left_ankle", "right_ankle"} <= set(names):
        raise CheckSkipped("it returns no world points")
    height = answer.world[:, [names.index("left_ankle"), names.index("right_ankle")], 1].mean(axis=1)
    height = height - answer.world[:, names.index("nose"), 1]
    expect(
        bool((height > 0).all()),
        "y down in the world points: a larger y of the ankles than of the nose",
        f"{np.round(height, 2).tolist()} m more",
    )
    expect(
        bool(((height > 0.5) & (height < 3)).all()),
        "metres: 0.5-3 m from nose to ankles of a standing person",
        f"{np.round(height, 2).tolist()}",
    )
    flat, seen = answer.points[..., 0], answer.confidence > 0
    slopes = [_line(flat[i, s], answer.world[i, s, 0])[1] for i, s in enumerate(seen) if s.sum() > MIN_JOINTS]
    expect(min(slopes, default=1) > 0, "x of the world points to the right, as in the photo", "x to the left")


def _sides(case: Case) -> FloatArray:
    """Return the larger side of each person's box (N,), px."""
    sides: FloatArray = (case.people.boxes[:, 2:] - case.people.boxes[:, :2]).max(axis=1)
    return sides


def _normalised(answer: Keypoints, case: Case) -> tuple[FloatArray, FloatArray, BoolArray, Skeleton]:
    """Return detected and true points (N, J, 2) about the boxes' centres, in sides of the boxes."""
    points, true, seen, skeleton = comparable_keypoints(answer, case.truth)
    boxes, sides = case.people.boxes, _sides(case)[:, None, None]
    centre = ((boxes[:, :2] + boxes[:, 2:]) / 2 - 0.5)[:, None]
    return (points - centre) / sides, (true - centre) / sides, seen, skeleton


def _line(places: FloatArray, values: FloatArray) -> tuple[float, float]:
    """Return offset and slope of the values (K,) over places (K,) by least squares."""
    design = np.stack([np.ones_like(places), places], axis=1)
    offset, slope = np.linalg.lstsq(design, values, rcond=None)[0]
    return float(offset), float(slope)


def _line_errors(places: FloatArray, values: FloatArray) -> tuple[float, float]:
    """Return three standard errors of offset and slope of a line over the joints (J,)."""
    kept = np.isfinite(places) & np.isfinite(values)
    offset, slope = _line(places[kept], values[kept])
    _, three = mean_and_margin(values[kept] - offset - slope * places[kept])
    return three, three / max(float(places[kept].std()), 1e-9)


def _means(values: FloatArray) -> FloatArray:
    """Return the means (J, 2) over people of values (N, J, 2), NaN without any."""
    known = np.isfinite(values)
    means: FloatArray = np.where(known, values, 0).sum(0) / np.where(known.any(0), known.sum(0), np.nan)
    return means


_READ = "physic_core.types.Keypoints"
_KNOWN = ("skeleton_is_known",)
_PLACED = (*_KNOWN, "joints_lie_on_the_person", "reads_images_as_rgb")
CHECKS: tuple[Check, ...] = (
    *PEOPLE_CHECKS,
    Check(check_skeleton_is_known, _READ),
    Check(check_joints_lie_on_the_person, _READ, after=_KNOWN),
    Check(check_joints_are_in_order, _READ, after=_PLACED, unless=BLIND),
    Check(check_joints_are_not_shifted_or_scaled, _READ, after=(*_PLACED, "joints_are_in_order"), unless=BLIND),
    Check(check_confidence_is_higher_in_sight, _READ, after=_KNOWN, unless=BLIND),
    Check(check_world_points_are_metres, _READ, after=(*_KNOWN, "joints_are_in_order")),
    Check(check_rows_follow_the_people, _READ),
)
"""Checks of a KeypointDetector, in order of execution."""
