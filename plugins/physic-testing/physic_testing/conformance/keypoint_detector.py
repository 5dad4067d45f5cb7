"""Checks of a KeypointDetector: known skeleton, pixel coordinates and left-right order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import BodyModelError
from physic_core.types import SKELETONS, Skeleton
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.output_checks import PEOPLE_CHECKS
from physic_testing.conformance.row_order import check_rows_follow_the_people
from physic_testing.conformance.truth import comparable_keypoints, mirrored_order

if TYPE_CHECKING:
    from physic_testing.conformance.backend_under_test import BackendUnderTest

__all__ = ["CHECKS"]

MAX_ERROR = 0.25
"""Maximum median error as a share of the larger side of the person's box."""


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


def check_left_is_the_persons_left(subject: BackendUnderTest) -> None:
    """Left joints are on the person's left side."""
    points, true, seen, skeleton = comparable_keypoints(subject.result(), subject.case("one person").truth)
    other = mirrored_order(skeleton.names)
    sided = seen & seen[:, other] & (np.array(other) != np.arange(len(other)))
    if not sided.any():
        raise CheckSkipped("no left-right pair of joints is visible")
    right = float(np.linalg.norm(points - true, axis=2)[sided].mean())
    swapped = float(np.linalg.norm(points[:, other] - true, axis=2)[sided].mean())
    expect(
        swapped > 0.5 * right,
        "left joints on the person's own left",
        f"{right:.1f} px off as they are, {swapped:.1f} px with left and right exchanged",
    )


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


_READ = "physic_core.types.Keypoints"
_KNOWN = ("skeleton_is_known",)
CHECKS: tuple[Check, ...] = (
    *PEOPLE_CHECKS,
    Check(check_skeleton_is_known, _READ),
    Check(check_joints_lie_on_the_person, _READ, after=_KNOWN),
    Check(check_left_is_the_persons_left, _READ, after=(*_KNOWN, "joints_lie_on_the_person")),
    Check(check_world_points_are_metres, _READ, after=_KNOWN),
    Check(check_rows_follow_the_people, _READ),
)
"""Checks of a KeypointDetector, in order of execution."""
