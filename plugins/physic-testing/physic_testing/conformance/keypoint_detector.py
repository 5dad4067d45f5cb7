"""Checks of a KeypointDetector: a known joint set, in the photo's pixels, left on the person's left."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import BodyModelError
from physic_core.types import SKELETONS, Skeleton
from physic_testing.conformance.answering import CHECKS_OF_PEOPLE
from physic_testing.conformance.check import Check
from physic_testing.conformance.expect import CheckSkipped, expect
from physic_testing.conformance.rows import check_rows_follow_the_people
from physic_testing.conformance.truth import mirrored_order, true_keypoints

if TYPE_CHECKING:
    from physic_testing.conformance.subject import Subject

__all__ = ["CHECKS"]

MOST_ERROR = 0.25
"""Median error as a share of the larger side of the person's box."""


def check_skeleton_is_known(subject: Subject) -> None:
    """`skeleton` is the name of a standard one, or a Skeleton whose points lie on a body, with as many points."""
    from physic_core.body import load_body

    answer = subject.answer()
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


def check_joints_lie_on_the_person(subject: Subject) -> None:
    """The joints that the photo shows are near the true ones, in px of the photo."""
    answer, truth = subject.answer(), subject.case("one person").truth
    points, true, seen, _ = true_keypoints(answer, truth)
    if not seen.any():
        raise CheckSkipped("it is sure of no joint")
    sides = (truth.boxes[:, 2:] - truth.boxes[:, :2]).max(axis=1)[:, None]
    error = float(np.median((np.linalg.norm(points - true, axis=2) / sides)[seen]))
    turned = float(np.median((np.linalg.norm(points[..., ::-1] - true, axis=2) / sides)[seen]))
    hint = (
        "x comes first, then y."
        if turned < MOST_ERROR
        else "Are they in px of the photo, not of a crop, nor in shares?"
    )
    expect(
        error < MOST_ERROR,
        f"x y px of the photo, a median error below {MOST_ERROR:.0%} of the person's box",
        f"{error:.0%}; joint 0 at {np.round(points[0, 0], 2).tolist()} px, truly {np.round(true[0, 0], 1).tolist()}",
        hint,
    )


def check_left_is_the_persons_left(subject: Subject) -> None:
    """Left joints are on the person's own left."""
    points, true, seen, skeleton = true_keypoints(subject.answer(), subject.case("one person").truth)
    other = mirrored_order(skeleton.names)
    sided = seen & seen[:, other] & (np.array(other) != np.arange(len(other)))
    if not sided.any():
        raise CheckSkipped("it sees no pair of joints")
    right = float(np.linalg.norm(points - true, axis=2)[sided].mean())
    swapped = float(np.linalg.norm(points[:, other] - true, axis=2)[sided].mean())
    expect(
        swapped > 0.5 * right,
        "left joints on the person's own left",
        f"{right:.1f} px off as they are, {swapped:.1f} px with left and right exchanged",
    )


def check_world_points_are_metres(subject: Subject) -> None:
    """`world`, where it is given, is in metres with y down: the head of who stands is above the feet."""
    answer = subject.answer()
    names = answer.joint_set.names
    if answer.world is None or not {"nose", "left_ankle", "right_ankle"} <= set(names):
        raise CheckSkipped("it answers no world points")
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
    *CHECKS_OF_PEOPLE,
    Check(check_skeleton_is_known, _READ),
    Check(check_joints_lie_on_the_person, _READ, after=_KNOWN),
    Check(check_left_is_the_persons_left, _READ, after=(*_KNOWN, "joints_lie_on_the_person")),
    Check(check_world_points_are_metres, _READ, after=_KNOWN),
    Check(check_rows_follow_the_people, _READ),
)
"""In the order in which they make sense."""
