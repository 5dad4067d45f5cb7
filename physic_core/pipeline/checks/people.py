"""Self-checks of each person: outputs, placement, photo, support, depth and size.

Measured on photos of all kinds, run with the embedded backends.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.joints import JOINT_INDEX, joint_pair
from physic_core.body.posture import angle_deg, lean_deg, standing_legs
from physic_core.engine.joint.terms.picture import ReprojectionSettings
from physic_core.engine.touch import LEAST_PROBABILITY
from physic_core.pipeline.checks.photo import NO_FLOOR, relative_difference
from physic_core.pipeline.checks.spec import YES, check
from physic_core.types import skeleton_named
from physic_core.types.skeletons import SIDES, keypoint_in_words

if TYPE_CHECKING:
    from physic_core.engine.state import Estimates
    from physic_core.pipeline.checks.spec import Measured
    from physic_core.pipeline.solution import Solution
    from physic_core.types import BoolArray, FloatArray, Intrinsics, Skeleton

_KNEES = joint_pair("knee")
_ANKLES = joint_pair("ankle")
_SHOULDERS = joint_pair("shoulder")
_STRAIGHT_DEG = 12.0  # of a leg in the photo
_NO_BODY = "no body was estimated, or none of it can be measured"
_ASSUMED_SUPPORT = "a support not visible in the scene is assumed to carry this person"
_NO_JOINTS = "the body estimator does not report which joints are visible"

_LIMB_JOINTS = tuple(
    f"{side}_{name}"
    for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    for side in SIDES
)
_HEAD = ("nose", "eye_surface", "ear_surface")
_FEWEST_HEAD = 3
_CONFIDENT = 0.5
_FEWEST = 4
_QUANTILE = 0.9  # two joints of a dozen may be wrong

_check = partial(check, "person")


@_check("Backends without a result", at_most=0, unit="count", warns=True)
def missing_outputs(estimates: Estimates, solution: Solution, person: int) -> Measured:
    """Return the number of backends that returned no valid values for this person."""
    missing = estimates.missing_results[person] if estimates.missing_results else ()
    return float(len(missing)), (
        f"no valid values for this person from {', '.join(missing)}: results that need them are "
        f"skipped; try another "
        "backend"
    )


@_check("Placed by keypoints, depth and floor", at_least=1, unit=YES, needed=True, warns=True)
def placed(estimates: Estimates, solution: Solution, person: int) -> Measured:
    """Return whether keypoints, depth and floor place the body, and the joint fit includes it."""
    if problem := solution.people[person].get("placement_problem"):
        return 0.0, str(problem)
    if failure := solution.failures[person]:
        return 0.0, f"pose and position are those before the joint fit: {failure}"
    if solution.scene.floor is None:
        return None, f"{NO_FLOOR}: the position is by size and scene alone"
    return 1.0


# Of 355 people in photos, 10 have a second head: of 9 of them, mask or pose is mixed up with
# another person's.
@_check(
    "Heads in the mask",
    at_most=1,
    unit="count",
    weak=True,
    warns=True,
    advice="two people may be one, or mixed up: another head lies in this person's mask",
)
def heads(estimates: Estimates, solution: Solution, person: int) -> Measured:
    """Return the number of heads in this person's mask: those that the segmenter sees, or those of
    other people.
    """
    mask = estimates.people.masks[person]
    keypoints = estimates.keypoints
    found = 1
    columns = [
        i for i, name in enumerate(skeleton_named(keypoints.skeleton).names) if name.endswith(_HEAD)
    ]
    for other in set(range(len(solution.people))) - {person}:
        seen = [i for i in columns if keypoints.confidence[other, i] >= _CONFIDENT]
        x, y = np.rint(keypoints.points[other, seen]).astype(int).T
        inside = (x >= 0) & (y >= 0) & (x < mask.shape[1]) & (y < mask.shape[0])
        found += len(seen) >= _FEWEST_HEAD and mask[y[inside], x[inside]].sum() > len(seen) / 2
    counted = estimates.people.heads
    return float(found if counted is None else max(found, int(counted[person])))


# Right bodies 0.013-0.033; bodies of the wrong person 0.036-0.15.
@_check(
    "Limbs off their keypoints",
    at_most=0.035,
    share_of="the box diagonal",
    needed=True,
    advice="a limb misses its keypoints: its pose is doubtful, check the overlay in preview.png",
    unmeasured="too few limb joints have a confident keypoint",
)
def limb_keypoints(estimates: Estimates, solution: Solution, person: int) -> Measured:
    """Return :func:`limb_keypoint_error` of this person."""
    return limb_keypoint_error(
        solution.joints[person],
        estimates.keypoints.points[person],
        estimates.keypoints.confidence[person],
        np.asarray(estimates.people.boxes[person], np.float64),
        estimates.keypoints.skeleton,
        solution.intrinsics,
    )


# Right bodies 0.97-1.00, 0.8 under wide clothes; a body in half of its person 0.78, other wrong
# poses 0.70-0.86.
@_check(
    "Person covered by the body",
    at_least=0.9,
    share_of="the mask",
    needed=True,
    advice="the body does not cover all of the person in the photo: a limb, the pose or the size "
    "is wrong",
    unmeasured=_NO_BODY,
)
def mask_covered(estimates: Estimates, solution: Solution, person: int) -> Measured:
    """Return the share of the mask within the body's silhouette, dilated for clothes."""
    return _measure(solution, person, "mask_covered_share")


# Right bodies 0.90-1.00; bodies of people who are hardly visible 0.65-0.85.
@_check(
    "Body within the person",
    at_least=0.85,
    share_of="the silhouette",
    advice="the body reaches beyond the person in the photo: the pose, the size or the mask is "
    "wrong, or an object "
    "hides a part",
    unmeasured=_NO_BODY,
)
def body_in_mask(estimates: Estimates, solution: Solution, person: int) -> Measured:
    """Return the share of the visible silhouette within the mask."""
    return _measure(solution, person, "body_in_mask_share")


# Full bodies 0.77-0.98; cut at the waist 0.46-0.75; behind another's back 0.23, and there the body
# is a guess.
@_check(
    "Visible in the photo",
    at_least=0.4,
    share_of="the side towards the camera",
    weak=True,
    advice="most of the body is hidden or outside the photo: the parts not visible are a guess",
    unmeasured=_NO_BODY,
)
def visible(estimates: Estimates, solution: Solution, person: int) -> Measured:
    """Return the visible share of the surface that faces the camera."""
    return _measure(solution, person, "seen_share")


# The pose of a trunk whose shoulders are outside of the photo is a guess, however well the legs
# fit.
@_check(
    "Number of visible shoulders",
    at_least=1,
    unit="count",
    weak=True,
    advice="neither shoulder is visible: the pose of trunk and arms is a guess",
    unmeasured=_NO_JOINTS,
)
def shoulders_seen(estimates: Estimates, solution: Solution, person: int) -> Measured:
    """Count the visible shoulders."""
    observed = _visible_joints(estimates, person)
    return None if observed is None else float(observed[_SHOULDERS].sum())


@_check(
    "Number of visible legs",
    at_least=2,
    unit="count",
    weak=True,
    advice="neither knee nor ankle of one leg is visible: its pose and its contacts are a guess",
    unmeasured=_NO_JOINTS,
)
def legs_seen(estimates: Estimates, solution: Solution, person: int) -> float | None:
    """Count the legs with a visible knee or ankle."""
    observed = _visible_joints(estimates, person)
    return None if observed is None else float((observed[_KNEES] | observed[_ANKLES]).sum())


# Bodies that touch 0; placed or posed wrongly, or above a wrong floor, 0.16-2.4.
@_check(
    "Distance to the nearest surface",
    at_most=0.1,
    unit="m",
    needed=True,
    advice="nothing supports this person: neither the floor nor a surface of the scene is near",
    unmeasured="there is no floor and no surface near the body",
)
def support(estimates: Estimates, solution: Solution, person: int) -> Measured:
    """Return the gap between the body and the nearest surface, metres; unknown if a support is
    assumed.
    """
    if _measure(solution, person, "assumed_support"):
        return None, _ASSUMED_SUPPORT
    return _measure(solution, person, "clearance_m")


# Of people in labelled photos, 94 % of those who sit have a seat or a larger probability, and 14 %
# of the others.
@_check(
    "Sits where the scene has no seat, probability",
    at_most=0.15,
    weak=True,
    advice="this person may sit, but the scene has no seat under them: do not use their seat",
    unmeasured="the photo shows neither buttocks nor thighs, or this preset estimates no "
    "probability of sitting",
)
def seat(estimates: Estimates, solution: Solution, person: int) -> Measured:
    """Return the probability of sitting; 0 with a seat in the scene."""
    return _measure(solution, person, "seat_missing")


# On floors that are right 0-0.08, and 0.25 on a treadmill; with wrong floors 0.6-1.7 above or
# below.
@_check("Lower sole off the floor", at_most=0.1, unit="m", unmeasured=_NO_BODY)
def sole_height(estimates: Estimates, solution: Solution, person: int) -> Measured:
    """Return the distance of the lower sole below the floor, or above it if the person stands,
    metres.
    """
    height = _measure(solution, person, "sole_height_m")
    if solution.scene.floor is None:
        return None, NO_FLOOR
    if height is None:
        return None
    if height > 0:
        # Only the feet of people who stand and whose legs are visible must be on the floor.
        if unknown := _unknown_support(estimates, solution, person):
            return None, unknown
        if not estimates.stance.stands_on_both_feet[person]:
            return None, "this person does not stand on both feet"
    side = "above" if height > 0 else "below"
    return abs(height), (
        f"the lower sole is {abs(height):.2f} m {side} the floor: the floor or the person's "
        f"distance is wrong"
    )


# Of 16 people who stand in films with known gravity, 14 up to 6; two of 11 and 12 lean by 9 and 10
# too much. On a floor that is off by 22 degrees 10 to 13. Sideways tilt is visible in the photo and
# not checked.
@_check("Leans towards the camera or away", at_most=8, unit="deg", unmeasured=_NO_BODY)
def lean(estimates: Estimates, solution: Solution, person: int) -> Measured:
    """Return the tilt towards the camera or away of a person who stands or walks on a straight leg,
    degrees.
    """
    joints = solution.joints[person]
    plane = solution.scene.floor
    unknown = _unknown_support(estimates, solution, person)
    if unknown or plane is None:
        return None, unknown or NO_FLOOR
    if not np.isfinite(joints).all():
        return None
    legs = standing_legs(joints, plane.normal)
    if not legs.any() or estimates.stance.stands[person].max() < LEAST_PROBABILITY:
        return None, "this person does not stand straight"
    part = lean_deg(joints, plane, legs=legs)[1]
    return abs(part), (
        f"this person stands and leans {_towards(part)}: one photo hardly shows this, so the pose "
        f"or the floor is "
        "doubtful"
    )


# An upright trunk that is an eighth shorter looks like one bent by 30 degrees. Right bodies up to
# 22, one wrong 34.
@_check("Trunk bent towards the camera or away", at_most=30, unit="deg", weak=True)
def bend(estimates: Estimates, solution: Solution, person: int) -> Measured:
    """Return the tilt of the trunk over straight upright legs, degrees."""
    joints = solution.joints[person]
    plane = solution.scene.floor
    if plane is None:
        return None, NO_FLOOR
    if not standing_legs(joints, plane.normal, trunk=False).all():
        return None, "this person does not stand on straight legs"
    part = lean_deg(joints, plane, "trunk")[1]
    return abs(part), (
        f"the trunk is bent by {_towards(part)}: the photo cannot distinguish this from a trunk "
        f"of another length"
    )


# True knees of 23 such legs in films: 6, and 17 in nine of ten. Of 60 in photos four exceed it (46
# to 60). None is of a person whom the other checks call good.
@_check(
    "Knee bent where the photo shows a straight leg",
    at_most=35,
    unit="deg",
    weak=True,
    unmeasured="no leg of this person is straight in the photo, or this person sits",
)
def knees(estimates: Estimates, solution: Solution, person: int) -> Measured:
    """Return the larger bend of the knees whose hip, knee and ankle are in line in the photo,
    degrees.
    """
    joints = solution.joints[person]
    keypoints = estimates.keypoints
    if (
        not np.isfinite(joints).all()
        or (_measure(solution, person, "sits") or 0.0) >= LEAST_PROBABILITY
    ):
        return None
    names = skeleton_named(keypoints.skeleton).names
    bends = []
    for side in SIDES:
        leg = [f"{side}_{name}" for name in ("hip", "knee", "ankle")]
        rows = [names.index(name) for name in leg if name in names]
        if len(rows) < len(leg) or keypoints.confidence[person, rows].min() < _CONFIDENT:
            continue
        hip, knee, ankle = keypoints.points[person, rows]
        if angle_deg(hip - knee, knee - ankle) < _STRAIGHT_DEG:
            hip, knee, ankle = joints[[JOINT_INDEX[name] for name in leg]]
            bends.append(float(angle_deg(hip - knee, knee - ankle)))
    if not bends:
        return None
    return max(bends), (
        f"a knee is bent by {max(bends):.0f} degrees towards the camera, and the photo shows a "
        f"straight leg: the pose "
        "of this leg is doubtful"
    )


# Right people on right floors 0-0.2; seats and floors that are wrong 0.26-0.9.
@_check(
    "Depth at feet or seat differs from the body's",
    at_most=0.25,
    needed=True,
    unmeasured="too few pixels at the lower end of the body are visible and have a depth",
)
def low_depth(estimates: Estimates, solution: Solution, person: int) -> Measured:
    """Return the difference of the photo's depth from the body's at the lower end of the
    silhouette, as a share.
    """
    ratio = _measure(solution, person, "low_depth_ratio")
    if ratio is None:
        return None
    return relative_difference(ratio), (
        f"the depth at feet or seat is {ratio:.2f} times that of the body: person and ground do "
        f"not meet"
    )


# The errors of the given size and of the others' are in the unit.
@_check("Size against the given one", at_most=3, unit="sigma", weak=True, warns=True, optional=True)
def given_size(estimates: Estimates, solution: Solution, person: int) -> Measured:
    """Return by how many standard deviations the size in the photo differs from that of a given age
    or stature.
    """
    report = solution.people[person]
    given, shown = (report.get(f"{name}_stature_m") for name in ("given", "shown"))
    if given is None or shown is None:
        return None
    stature = None if estimates.statures is None else estimates.statures[person]
    age = None if estimates.ages is None else estimates.ages[person]
    origin = (
        "was given"
        if stature is not None and math.isfinite(stature)
        else f"is usual at {age:g} years"
    )
    return report["stature_sigmas"], (
        f"the photo shows {shown:.2f} m, and {given:.2f} m {origin}: check the ages and statures "
        f"that you gave"
    )


# In sigmas of the joint fit, and beyond as many as it takes for an outlier. Of 1581 limb joints of
# 147 people graded good, whose keypoints were detected, none is farther off than 4.
@_check(
    "Given keypoints off the body",
    at_most=ReprojectionSettings.outlier_sigmas,
    unit="sigma",
    weak=True,
    warns=True,
    optional=True,
)
def given_keypoints(estimates: Estimates, solution: Solution, person: int) -> Measured:
    """Return by how many standard deviations the body misses the worst of the keypoints that the
    user gave.
    """
    report = solution.people[person]
    off = report.get("given_keypoints_px")
    if not off:
        return None
    worst = max(off, key=off.__getitem__)
    file_px = off[worst] * estimates.file_px
    return off[worst] / (ReprojectionSettings.sigma * report["stature_px"]), (
        f"the given {keypoint_in_words(worst)} lies {file_px:.0f} px from where the rest of the "
        f"photo puts it: "
        "check the keypoints that you gave"
    )


# Of 202 visible joints that people marked in 12 photos one is farther, of 155 hidden ones nine.
@_check(
    "Given keypoints against mask and detector",
    at_most=0.1,
    share_of="the box diagonal",
    weak=True,
    warns=True,
    optional=True,
)
def contradicted_keypoints(estimates: Estimates, solution: Solution, person: int) -> Measured:
    """Return how far mask and detector contradict the worst of the keypoints that the user gave, as
    a share.
    """
    given = estimates.given_keypoints
    contradicted = estimates.contradicted_px
    if given is None or contradicted is None or not given[person].any():
        return None
    off = contradicted[person]
    box = estimates.people.boxes[person]
    worst = int(off.argmax())
    name = keypoint_in_words(estimates.keypoints.joint_set.names[worst])
    return float(off[worst] / np.hypot(box[2] - box[0], box[3] - box[1])), (
        f"the given {name} lies {off[worst] * estimates.file_px:.0f} px from where mask and "
        f"detector have it: "
        "check the keypoints that you gave"
    )


def limb_keypoint_error(
    joints: FloatArray,
    points: FloatArray,
    confidence: FloatArray,
    box: FloatArray,
    skeleton: Skeleton | str,
    camera: Intrinsics,
) -> float | None:
    """Return the 0.9 quantile of the limb joints' distances from their confident keypoints, as a
    share of the box's diagonal.

    Args:
        joints: (55, 3) of the body, in the frame of the camera, metres.
        points: (J, 2) keypoints of the person, px.
        confidence: (J,) of the keypoints.
        box: (4,) of the person, px, x0 y0 x1 y1.
        skeleton: of the keypoints.
        camera: of the photo.

    Returns:
        None with fewer than four such keypoints or without a body.
    """
    names = skeleton_named(skeleton).names
    rows = {name: names.index(name) for name in _LIMB_JOINTS if name in names}
    chosen = [name for name, row in rows.items() if confidence[row] >= _CONFIDENT]
    diagonal = float(np.hypot(box[2] - box[0], box[3] - box[1]))
    if len(chosen) < _FEWEST or diagonal <= 0:
        return None
    pixels = (
        np.asarray(joints[[JOINT_INDEX[name] for name in chosen]], np.float64) @ camera.matrix.T
    )
    errors = np.linalg.norm(
        points[[rows[name] for name in chosen]] - pixels[:, :2] / pixels[:, 2:], axis=1
    )
    return (
        float(np.quantile(errors, _QUANTILE, method="lower")) / diagonal
        if np.isfinite(errors).all()
        else None
    )


def _measure(solution: Solution, person: int, name: str) -> float | None:
    """Return a number of :func:`physic_core.pipeline.person_measures.measure_people`; None if it
    was not measured.
    """
    value: float | None = solution.people[person].get(name)
    return value


def _unknown_support(estimates: Estimates, solution: Solution, person: int) -> str | None:
    """Return why it is unknown what carries a person, or None if it is known."""
    if _measure(solution, person, "assumed_support"):
        return _ASSUMED_SUPPORT
    if solution.scene.floor is None:
        return NO_FLOOR
    legs = legs_seen(estimates, solution, person)
    return None if legs is None or legs == 2 else "a leg is not visible"


def _towards(part: float) -> str:
    """Return an angle towards the camera in words; a negative one is away from it."""
    return f"{abs(part):.0f} degrees {'towards' if part > 0 else 'away from'} the camera"


def _visible_joints(estimates: Estimates, person: int) -> BoolArray | None:
    """Return the joints (55,) that any photo shows; None if the backend does not report visible
    joints.
    """
    if estimates.bodies.observed is None:
        return None
    others = (view.observed[person].cpu().numpy() for view in estimates.views)
    visible: BoolArray = np.any([estimates.bodies.observed[person], *others], axis=0)
    return visible
