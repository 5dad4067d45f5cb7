"""Self-checks of one person: outputs, placement, photo, support and depth."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.joints import joint_pair
from physic_core.body.posture import lean_deg, standing_legs
from physic_core.pipeline.checks.keypoints import limb_keypoint_error, worst_limb_joint
from physic_core.pipeline.checks.result import Measurement, relative_difference

if TYPE_CHECKING:
    from physic_core.pipeline.estimate import Estimates
    from physic_core.pipeline.solution import Solution
    from physic_core.types import BoolArray

_KNEES, _ANKLES, _SHOULDERS = joint_pair("knee"), joint_pair("ankle"), joint_pair("shoulder")
_NO_FLOOR = "no floor was found"
_NO_BODY = "there is no body, or no part of it to measure"
_HIDDEN_LEG = "a leg is not visible"
_ASSUMED_SUPPORT = "a support not visible in the scene is assumed to carry this person"


def check_person(estimates: Estimates, solution: Solution, person: int) -> Iterator[Measurement]:
    """Run the self-checks of one person."""
    yield from _check_outputs(estimates, solution, person)
    yield from _check_picture(estimates, solution, person)
    yield from _check_support(estimates, solution, person)
    yield from _check_depth(solution, person)
    yield from _check_size(estimates, solution, person)


def _check_outputs(estimates: Estimates, solution: Solution, person: int) -> Iterator[Measurement]:
    missing = estimates.missing_results[person] if estimates.missing_results else ()
    yield Measurement(
        "missing_outputs",
        float(len(missing)),
        f"no valid values for this person from {', '.join(missing)}: results that need them are skipped; "
        "try another backend",
    )
    problem, no_floor = solution.people[person].get("placement_problem"), _no_floor(solution)
    yield Measurement(
        "placed",
        0.0 if problem else 1.0 if no_floor is None else None,
        str(problem),
        unmeasured=f"{no_floor}: the position is by size and scene alone",
    )
    failure = solution.failures[person]
    yield Measurement(
        "optimised",
        float(not failure),
        f"pose and position are those of the placement: {failure}",
    )


def _check_picture(estimates: Estimates, solution: Solution, person: int) -> Iterator[Measurement]:
    report = solution.people[person]
    yield Measurement(
        "reprojection",
        report.get("reprojection_share"),
        "the body misses confident keypoints: its pose is doubtful, check the overlay in preview.png",
        unmeasured="no keypoint is confident, or there is no body",
    )
    seen = (
        solution.joints[person],
        estimates.keypoints.points[person],
        estimates.keypoints.confidence[person],
        np.asarray(estimates.people.boxes[person], np.float64),
        estimates.keypoints.skeleton,
        solution.intrinsics,
    )
    yield Measurement(
        "limb_keypoints",
        limb_keypoint_error(*seen),
        "a limb misses its keypoints: its pose is doubtful, check the overlay in preview.png",
        unmeasured="too few limb joints have a confident keypoint",
    )
    distance, joint = worst_limb_joint(*seen, estimates.people.masks[person])
    yield Measurement(
        "limb_joint",
        distance,
        f"the photo shows the {joint.replace('_', ' ')}, but the body's is elsewhere: do not trust this limb",
        unmeasured="no elbow, wrist or knee is visible, or there is no body",
    )
    yield Measurement(
        "mask_covered",
        report.get("mask_covered_share"),
        "the body does not cover all of the person in the photo: a limb, the pose or the size is wrong",
        unmeasured=_NO_BODY,
    )
    yield Measurement(
        "body_in_mask",
        report.get("body_in_mask_share"),
        "the body reaches beyond the person in the photo: the pose, the size or the mask is wrong, or an object hides "
        "a part",
        unmeasured=_NO_BODY,
    )
    yield Measurement(
        "visible",
        report.get("seen_share"),
        "most of the body is hidden or outside the photo: the parts not visible are a guess",
        unmeasured=_NO_BODY,
    )
    observed = _visible_joints(estimates, person)
    yield Measurement(
        "shoulders_seen",
        None if observed is None else float(observed[_SHOULDERS].sum()),
        "neither shoulder is visible: the pose of trunk and arms is a guess",
        unmeasured="the body estimator does not report which joints are visible",
    )
    legs = _visible_legs(estimates, person)
    yield Measurement(
        "legs_seen",
        None if legs is None else float(legs),
        "neither knee nor ankle of one leg is visible: its pose and its contacts are a guess",
        unmeasured="the body estimator does not report which joints are visible",
    )


def _check_support(estimates: Estimates, solution: Solution, person: int) -> Iterator[Measurement]:
    report = solution.people[person]
    yield Measurement(
        "penetration",
        report.get("penetration_share"),
        "the body penetrates the scene: its position or the scene behind it is wrong, do not use its contacts",
        unmeasured=_NO_BODY,
    )
    # With an invisible leg or an assumed support, what carries the person is unknown.
    legs = _visible_legs(estimates, person)
    assumed = _ASSUMED_SUPPORT if report.get("assumed_support") else None
    unknown = assumed or _no_floor(solution) or (None if legs is None or legs == 2 else _HIDDEN_LEG)
    yield Measurement(
        "floating",
        report.get("support_gap_m") if unknown is None else None,
        "the body floats in the air: its distance or the floor is wrong, or its support is missing from the scene",
        unmeasured=unknown or _NO_BODY,
    )
    yield Measurement(
        "support",
        report.get("clearance_m") if assumed is None else None,
        "nothing supports this person: neither the floor nor a surface of the scene is near",
        unmeasured=assumed or "there is no floor and no surface near the body",
    )
    yield Measurement(
        "seat",
        report.get("seat_missing"),
        "this person may sit, but the scene has no seat under them: do not use their seat",
        unmeasured="this preset estimates no probability of sitting",
    )
    yield Measurement(
        "balance",
        report.get("balance_m"),
        "the centre of mass is not over the support: the person moves, or the pose or a contact is wrong",
        unmeasured="nothing carries this person",
    )
    yield _check_soles(estimates, solution, person, unknown)
    yield _check_lean(solution, person, unknown)
    yield _check_bend(solution, person)


def _check_depth(solution: Solution, person: int) -> Iterator[Measurement]:
    report = solution.people[person]
    ratio = report.get("low_depth_ratio")
    yield Measurement(
        "low_depth",
        None if not ratio else relative_difference(ratio),
        f"the depth at feet or seat is {ratio or 1:.2f} times that of the body: person and ground do not meet",
        unmeasured="too few pixels at the lower end of the body are visible and have a depth",
    )
    yield Measurement(
        "depth_map_order",
        report.get("reversed_depth"),
        "depth map and bodies disagree on whether this person is in front of another: who is nearer is doubtful",
        unmeasured="no other person has a body and a depth",
    )
    yield Measurement(
        "depth_order",
        report.get("depth_order_share"),
        "the body lies in front of a person who hides it in the photo: who is nearer is doubtful",
        unmeasured=_NO_BODY,
    )


def _check_size(estimates: Estimates, solution: Solution, person: int) -> Iterator[Measurement]:
    """Compare a given age or stature with the size shown by the photo; nothing if none is given."""
    report = solution.people[person]
    given, shown = (report.get(f"{name}_stature_m") for name in ("given", "shown"))
    if given is None or shown is None:
        return
    stature = None if estimates.statures is None else estimates.statures[person]
    age = None if estimates.ages is None else estimates.ages[person]
    origin = "was given" if stature is not None and math.isfinite(stature) else f"is usual at {age:g} years"
    yield Measurement(
        "given_size",
        report.get("stature_sigmas"),
        f"the photo shows {shown:.2f} m, and {given:.2f} m {origin}: check the ages and statures that you gave",
    )


def _check_soles(estimates: Estimates, solution: Solution, person: int, unknown: str | None) -> Measurement:
    """Compare the lower sole with the floor: people who stand touch it, and no person is below it."""
    height = solution.people[person].get("sole_height_m")
    floor = _no_floor(solution)
    if floor is None and height is not None and height > 0:
        # Only the feet of people who stand and whose legs are visible must be on the floor.
        stands = bool(estimates.stance.stands_on_both_feet[person])
        floor = unknown or (None if stands else "this person does not stand on both feet")
    side = "above" if (height or 0) > 0 else "below"
    return Measurement(
        "sole_height",
        abs(height) if height is not None and floor is None else None,
        f"the lower sole is {abs(height or 0):.2f} m {side} the floor: the floor or the person's distance is wrong",
        unmeasured=floor or _NO_BODY,
    )


def _check_lean(solution: Solution, person: int, unknown: str | None) -> Measurement:
    joints, floor = solution.joints[person], solution.scene.floor
    part = math.nan
    if unknown is None and floor is not None:
        if not np.isfinite(joints).all():
            unknown = _NO_BODY
        elif not standing_legs(joints).all():
            unknown = "this person does not stand straight"
        else:
            _, part = lean_deg(joints, floor)
    direction = "towards the camera" if part > 0 else "away from the camera"
    return Measurement(
        "lean",
        abs(part),
        f"this person stands and leans {abs(part):.0f} degrees {direction}: one photo hardly shows this, so "
        f"the pose or the floor is doubtful",
        unmeasured=unknown or _NO_BODY,
    )


def _check_bend(solution: Solution, person: int) -> Measurement:
    joints, floor = solution.joints[person], solution.scene.floor
    part, unknown = math.nan, _NO_FLOOR
    if floor is not None:
        unknown = "this person does not stand on straight legs"
        if standing_legs(joints, floor.normal, trunk=False).all():
            _, part = lean_deg(joints, floor, "trunk")
    direction = "towards the camera" if part > 0 else "away from the camera"
    return Measurement(
        "bend",
        abs(part),
        f"the trunk is bent by {abs(part):.0f} degrees {direction}: the photo cannot distinguish this from a trunk of "
        "another length",
        unmeasured=unknown,
    )


def _no_floor(solution: Solution) -> str | None:
    """Return why heights over the floor cannot be measured, or None if they can."""
    return _NO_FLOOR if solution.scene.floor is None else None


def _visible_legs(estimates: Estimates, person: int) -> int | None:
    """Count the legs with a visible knee or ankle; None if the backend does not report visible joints."""
    observed = _visible_joints(estimates, person)
    return None if observed is None else int((observed[_KNEES] | observed[_ANKLES]).sum())


def _visible_joints(estimates: Estimates, person: int) -> BoolArray | None:
    """Return the joints (55,) that any photo shows; None if the backend does not report visible joints."""
    if estimates.bodies.observed is None:
        return None
    others = (view.observed[person].cpu().numpy() for view in estimates.views)
    visible: BoolArray = np.any([estimates.bodies.observed[person], *others], axis=0)
    return visible
