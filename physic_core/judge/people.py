"""Self-checks of each person: outputs, placement, photo, support, depth and size.

Measured on photos of all kinds, run with the embedded backends.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from physic_core.body.joints import joint_pair
from physic_core.body.posture import LYING_DEG, lean_deg, standing_legs, trunk_tilt_deg
from physic_core.engine.body_parts import OBSERVED
from physic_core.engine.ground.posture import is_upright
from physic_core.judge.photo import NO_FLOOR, relative_difference
from physic_core.judge.spec import NO_BODY, OTHER_BODY, SIDE_VIEW, YES, check
from physic_core.types import MARKS, Plane, skeleton_named
from physic_core.types.contacts import SupportState, part_words
from physic_core.types.observations import CARRYING_PARTS, LEAST_PROBABILITY
from physic_core.types.records import in_words
from physic_core.types.skeletons import SURE_CONFIDENCE

if TYPE_CHECKING:
    from physic_core.engine.state import Estimates
    from physic_core.judge.spec import Measured
    from physic_core.types import (
        BoolArray,
        Person,
        Reconstruction,
    )

_KNEES = joint_pair("knee")
_ANKLES = joint_pair("ankle")
_UPRIGHT = ("stand", "walk", "run", "jump")
_SEATED = ("sit", "ride")  # postures of people on a seat
_ASSUMED_SUPPORT = "the photo does not show what carries this person, so a support is assumed"
_IN_THE_AIR = "this person is in the air, and touches nothing"
_NOT_TO_USE = f"see {SIDE_VIEW}. If it is wrong, do not use this distance, or give --stature METERS"

_HEAD = ("nose", "eye_surface", "ear_surface")
_FEWEST_HEAD = 3
_SUPPORT_M = 0.1  # largest distance from what carries
_FAR_BELOW_M = 0.5  # of soles below the floor: no error of a floor that people stand on
_LIES_DEG = 60.0  # lean beyond which people lie

_check = partial(check, "person")


@_check(
    "Placed by keypoints, depth and floor",
    at_least=1,
    unit=YES,
    contradicts=MARKS,
    warns=True,
)
def placed(estimates: Estimates, result: Reconstruction, person: int) -> Measured:
    """Return whether all backends have valid values for the person, the joint fit succeeded, and
    the soles are less than half a meter below the floor.
    """
    if missing := estimates.missing_results[person]:
        return 0.0, (
            f"this person has no valid values from {in_words(missing)}, so results that need them "
            f"are missing. Try another backend with --set {missing[0]}.backend=NAME"
        )
    measures = result.people[person].measures
    if measures.placement_problem:
        return 0.0, measures.placement_problem
    if failure := measures.joint_problem:
        return 0.0, f"pose and position are those before the joint fit: {failure}"
    height = measures.sole_height_m
    if height is not None and height < -_FAR_BELOW_M:
        return 0.0, (
            f"the body reaches {-height:.1f} m below the floor (limit {_FAR_BELOW_M:g} m), so its "
            "place is wrong. Do not use this person"
        )
    if result.scene.floor is None:
        return None, f"{NO_FLOOR}, so only the body's size and the depth give the distance"
    return 1.0


@_check(
    "Detection score",
    at_least=0.5,
    advice="the detection is uncertain: check the outline in preview.png. If it is not a real "
    "person, leave it out with --ignore X,Y (a pixel on it)",
)
def detected(estimates: Estimates, result: Reconstruction, person: int) -> Measured:
    """Return the score of the segmenter."""
    return float(estimates.photo.people.scores[person])


# Of 355 people in photos, 10 have a second head: of 9 of them, mask or pose is mixed up with
# another person's.
@_check(
    "Heads in the outline",
    at_most=1,
    unit="count",
    contradicts=("pose",),
    warns=True,
    advice="the mask contains two people, or one person was detected twice: see the outlines in "
    "preview.png, and give --person X,Y once for each person to keep",
    unmeasured="no pixel of the photo shows this person",
)
def heads(estimates: Estimates, result: Reconstruction, person: int) -> Measured:
    """Return the number of heads in the person's mask, by the segmenter or by other people's
    keypoints.
    """
    mask = estimates.photo.people.masks[person]
    if not mask.any():
        return None
    keypoints = estimates.photo.keypoints
    count = 1
    columns = [
        i for i, name in enumerate(skeleton_named(keypoints.skeleton).names) if name.endswith(_HEAD)
    ]
    for other in set(range(len(result.people))) - {person}:
        visible = [i for i in columns if keypoints.confidence[other, i] >= SURE_CONFIDENCE]
        x, y = np.rint(keypoints.points[other, visible]).astype(int).T
        inside = (x >= 0) & (y >= 0) & (x < mask.shape[1]) & (y < mask.shape[0])
        count += (
            len(visible) >= _FEWEST_HEAD and mask[y[inside], x[inside]].sum() > len(visible) / 2
        )
    counted = estimates.photo.people.heads
    return float(count if counted is None else max(count, int(counted[person])))


# Right bodies 0.90-1.00; bodies of people who are hardly visible 0.65-0.85.
@_check(
    "Body inside the outline",
    at_least=0.85,
    share_of="its visible silhouette",
    advice="pose, size or outline is wrong, or an object hides a part of the person: compare the "
    "bodies over the photo in preview.png. Correct a wrong outline with --masks FILE, a wrong body "
    "with --bodies FILE",
    unmeasured=NO_BODY,
)
def body_in_mask(estimates: Estimates, result: Reconstruction, person: int) -> Measured:
    """Return the share of the body's visible silhouette within the mask."""
    who = result.people[person]
    share = who.measures.body_in_mask_share
    if share is None and np.isfinite(who.joints).all():
        return None, "no visible part of this body can be compared"
    return share


# Bodies that touch 0; placed or posed wrongly, or above a wrong floor, 0.16-2.4. Soles on floors
# that are right 0-0.08, and 0.25 on a treadmill.
@_check(
    "Gap to floor or support",
    at_most=_SUPPORT_M,
    unit="m",
    contradicts=("place", "contact"),
    unmeasured="there is no floor and no surface near the body",
)
def support(estimates: Estimates, result: Reconstruction, person: int) -> Measured:
    """Return the largest of the gap between body and nearest surface, the depth of a lying body
    below the floor, and the distance of a standing person's lower sole from the floor.

    Meters. The gap does not count for people in the air, and where the support is assumed or
    touched without a surface of the scene. A sole below the floor counts for everybody.
    """
    subject = result.people[person]
    measures = subject.measures
    height = None if result.scene.floor is None else measures.sole_height_m
    reasons = []
    in_air = subject.support is not None and subject.support.state is SupportState.AIRBORNE
    lacks_surface = any(one.likely and one.distance_m is not None for one in subject.contacts)
    unasked = in_air or lacks_surface or measures.assumed_support
    if measures.clearance_m is not None and not unasked:
        gap = measures.clearance_m
        reasons.append(
            (
                gap,
                f"the nearest surface that could carry this person is {gap:.2f} m away. If the "
                f"person is not in the air, the person or the surface is misplaced: {_NOT_TO_USE}",
            )
        )
    if result.scene.floor is not None and lies(result, person):
        from physic_core.engine.limbs import LOWEST_SHARE

        heights = subject.vertices @ result.scene.floor.normal
        low = float(np.quantile(heights, LOWEST_SHARE)) + result.scene.floor.offset
        if low < -_SUPPORT_M:
            reasons.append(
                (
                    -low,
                    f"the body reaches {-low:.2f} m below the floor, so the floor or the person's "
                    f"distance is wrong: {_NOT_TO_USE}",
                )
            )
    stands = _stands_on_visible_legs(estimates, result, person)
    if height is not None and (height < 0 or stands):
        side = "above" if height > 0 else "below"
        reasons.append(
            (
                abs(height),
                f"the lower foot is {abs(height):.2f} m {side} the floor, so the floor or the "
                f"person's distance is wrong: {_NOT_TO_USE}",
            )
        )
    if reasons:
        return max(reasons)
    return (None, _IN_THE_AIR if in_air else _ASSUMED_SUPPORT) if unasked else None


# Of people whom readers find right 0.59 in the median, of others 0.40.
@_check(
    "Contact certainty",
    at_least=0.5,
    unmeasured="there is no body, or this preset estimates no probabilities",
)
def contact_sure(estimates: Estimates, result: Reconstruction, person: int) -> Measured:
    """Return the probability that all listed contacts of feet, hands and seat are right; for people
    who lie, that the least certain part carries them.

    It is 0 if none carries a person who lies.
    """
    subject = result.people[person]
    if not (part_probability := subject.world_contact):
        return None
    if lies(result, person):
        return _sure_carriers(subject)
    value = math.prod(
        max(part_probability[part], 1 - part_probability[part]) for part in CARRYING_PARTS
    )
    seated = subject.posture in _SEATED and (subject.posture_probability or 0.0) >= 0.5
    if seated and part_probability["seat"] < 0.5:
        probability = subject.posture_probability or 0.0
        return value, (
            f"this person probably {subject.posture}s (probability {probability:.2f}), but no seat "
            f"was detected under the body: see {SIDE_VIEW}, and do not use the contacts of the "
            f"buttocks"
        )
    least = min(CARRYING_PARTS, key=lambda part: abs(part_probability[part] - 0.5))
    taken = "listed" if part_probability[least] >= 0.5 else "not listed"
    return (
        value,
        f"the least certain contact is that of the {part_words(least)}, which is {taken} "
        f"(probability {part_probability[least]:.2f}): compare it with the photo, and do not use "
        "it if the photo contradicts it",
    )


def _level_plane(result: Reconstruction) -> Plane:
    """Return a level plane by what is known of up, else by the camera's axis."""
    return result.scene.level or Plane(np.array([0.0, -1.0, 0.0]), 0.0)


def lies(result: Reconstruction, person: int) -> bool:
    """Return whether the trunk of a person is nearly horizontal."""
    tilt = trunk_tilt_deg(result.people[person].joints, _level_plane(result).normal)
    return bool(abs(tilt - 90) < LYING_DEG)


def _sure_carriers(subject: Person) -> Measured:
    """Return the probability of the least sure part that carries a person, 0 if none does; of parts
    that the observer speaks of, if any is among them.
    """
    likely = {}
    if subject.support is not None and subject.support.state != SupportState.UNBALANCED:
        surest_last = sorted((one.probability or 0.0, one.part) for one in subject.support.contacts)
        likely = {part: probability for probability, part in surest_last if probability}
        likely = {part: p for part, p in likely.items() if part in OBSERVED} or likely
    if not likely:
        return 0.0, (
            f"none of the detected contacts carries this person: see {SIDE_VIEW}, and do not use "
            "these contacts"
        )
    least = min(likely, key=likely.__getitem__)
    return likely[least], (
        f"the least certain contact that carries this person is the {part_words(least)} "
        f"(probability {likely[least]:.2f}): compare it with the photo, and leave it out "
        "if the photo does not show it"
    )


# Of people whom readers find right 5 in the median, of others 15. Sideways tilt is visible in the
# photo and not checked.
@_check(
    "Lean toward or away from the camera",
    at_most=15,
    unit="deg",
    unmeasured=NO_BODY,
)
def lean(estimates: Estimates, result: Reconstruction, person: int) -> Measured:
    """Return the tilt of body or trunk, whichever is larger, toward or away from the camera; only
    of people who are upright in the photo and do not ride.

    Degrees. The body counts on straight legs with a visible ankle: other ankles do not lie under
    the hips.
    """
    joints = result.people[person].joints
    if not np.isfinite(joints).all():
        return None
    if (carried := estimates.ground.stance.carried) is not None and carried.rides[person]:
        return None, "this person rides, and may lean"
    plane = estimates.ground.search.plane
    if plane is not None and plane.beneath:
        return None, "this person lies"
    if not is_upright(estimates.photo.keypoints, estimates.photo.observations)[person]:
        return None, "this person is not upright in the photo, and may lean"
    floor = _level_plane(result)
    parts: list[Literal["body", "trunk"]] = ["trunk"]
    if _is_visible_joint(estimates, person)[_ANKLES].any() and standing_legs(joints).any():
        parts.append("body")
    leans = {part: lean_deg(joints, floor, part) for part in parts}
    part, part_deg = max(leans.items(), key=lambda item: abs(item[1]))
    if abs(part_deg) > _LIES_DEG:
        return abs(part_deg), (
            f"the {part} leans by {abs(part_deg):.0f}°: the person lies, or body or floor is "
            f"wrong. Compare {SIDE_VIEW} with the photo. {OTHER_BODY}"
        )
    return abs(part_deg), (
        f"the {part} leans {'toward' if part_deg > 0 else 'away from'} the camera by "
        f"{abs(part_deg):.0f}°, which one photo hardly shows: compare {SIDE_VIEW} with the photo. "
        f"{OTHER_BODY}"
    )


# Of people with one, readers find the contacts of 19 % right and the place of 35 %, of others 63
# and 83 %.
@_check(
    "Contacts without a surface nearby",
    at_most=0,
    unit="count",
    unmeasured="there is no body, or this preset estimates no probabilities",
)
def unknown_contacts(estimates: Estimates, result: Reconstruction, person: int) -> Measured:
    """Return the number of visible parts in contact that have no surface within 10 cm; only of
    people who do not lie.
    """
    subject = result.people[person]
    if not subject.world_contact:
        return None
    if lies(result, person):
        return None, "this person lies, and hides the surface below"
    far = [one.part for one in subject.contacts if one.likely and one.distance_m is not None]
    parts = dict.fromkeys(far)
    return float(len(parts)), (
        f"the photo shows contact of {in_words([*map(part_words, parts)])}, but no surface is "
        f"within {100 * _SUPPORT_M:.0f} cm: it is hidden, or body or scene is misplaced. See "
        f"{SIDE_VIEW}, and do not use the place of these contacts"
        if parts
        else ""
    )


# Right people on right floors 0-0.2; seats and floors that are wrong 0.26-0.9.
@_check(
    "Depth differs at feet or seat",
    at_most=0.25,
    advice="the person may be too near or too far, and contact with the ground wrong: "
    f"{_NOT_TO_USE}",
    unmeasured="too few pixels at the lower end of the body are visible and have a depth",
)
def low_depth(estimates: Estimates, result: Reconstruction, person: int) -> Measured:
    """Return the relative difference between the depths of photo and body at the lower end of the
    silhouette.
    """
    ratio = result.people[person].measures.low_depth_ratio
    return None if ratio is None else relative_difference(ratio)


# The errors of the given size and of the others' are in the unit.
@_check(
    "Given size differs from the photo",
    at_most=3,
    unit="sigma",
    contradicts=("place", "size"),
    warns=True,
    optional=True,
)
def given_size(estimates: Estimates, result: Reconstruction, person: int) -> Measured:
    """Return the difference between the stature in the photo and the given stature, or the usual
    stature of the given age, in standard deviations.
    """
    measured = result.people[person].measures
    given_m = measured.given_stature_m
    shown = measured.shown_stature_m
    sigmas = measured.stature_sigmas
    if given_m is None or shown is None or sigmas is None:
        return None
    stature, years = (own[person] for own in estimates.photo.known.filled(len(result.people)))
    origin = "" if math.isfinite(stature) else f", which is usual at {years:g} years"
    return sigmas, (
        f"this person is {shown:.2f} m tall in the photo, not {given_m:.2f} m{origin}. "
        "Check --stature and --age: their values go from left to right"
    )


# Of adults 0 to 2; a renderer's depth made one .60 m tall, and a mirrored one another 1.37 m.
@_check(
    "Stature unlikely",
    at_most=3,
    unit="sigma",
    contradicts=("size",),
    optional=True,
)
def stature(estimates: Estimates, result: Reconstruction, person: int) -> Measured:
    """Return the difference between the stature and the mean of adults, or of children if the
    person is probably a child, in standard deviations.

    Of people of known stature and age, it is that of the two.
    """
    from physic_core.engine.sizes.stature import stature_surprise, stature_surprise_at_age

    subject = result.people[person]
    if subject.stature is None:
        return None
    height, years = (own[person] for own in estimates.photo.known.filled(len(result.people)))
    if math.isfinite(height) and math.isfinite(years):
        return stature_surprise_at_age(height, years), (
            f"you gave {height:.2f} m and {years:g} years, which hardly go together: correct "
            "--stature or --age"
        )
    child = math.nan if subject.child_probability is None else subject.child_probability
    off = stature_surprise(
        subject.stature,
        child,
        stands=subject.posture in _UPRIGHT,
        is_given=_is_known(estimates, result, person),
    )
    return off, (
        f"this person is {subject.stature:.2f} m tall in the result, but probably "
        f"{'a child' if child >= LEAST_PROBABILITY else 'an adult'}: check units and sizes that "
        "you gave. If you gave none, do not use this size, or give --stature METERS"
    )


@_check(
    "Age of a child unknown",
    at_most=0.15,
    unit="log",
    contradicts=("size",),
    optional=True,
)
def child_size(estimates: Estimates, result: Reconstruction, person: int) -> Measured:
    """Return the relative standard deviation of the stature of a child who does not stand.

    It is not asked where you give age or stature, or where something measured gives the scale.
    """
    from physic_core.engine.sizes.evidence import MEASURED_SIGMA
    from physic_core.engine.sizes.stature import log_stature_of_children

    subject = result.people[person]
    sigma = result.scene.scale_sigma
    is_measured = sigma is not None and sigma <= MEASURED_SIGMA
    is_child = (
        subject.child_probability or 0.0
    ) >= LEAST_PROBABILITY and subject.posture not in _UPRIGHT
    if not is_child or is_measured or _is_known(estimates, result, person):
        return None
    return log_stature_of_children()[1], (
        "the height is that of children of 2 to 13 years, and wrong for a baby: give --age YEARS "
        "or --stature METERS"
    )


def _is_known(estimates: Estimates, result: Reconstruction, person: int) -> bool:
    """Return whether the user gave stature or age of a person."""
    known_sizes = estimates.photo.known.filled(len(result.people))
    return any(math.isfinite(values[person]) for values in known_sizes)


def _stands_on_visible_legs(estimates: Estimates, result: Reconstruction, person: int) -> bool:
    """Return whether a person stands on both feet, with a knee or an ankle of each leg visible, and
    without an assumed support.
    """
    if result.people[person].measures.assumed_support:
        return False
    visible = _is_visible_joint(estimates, person)
    if not (visible[_KNEES] | visible[_ANKLES]).all():
        return False
    return bool(estimates.ground.stance.stands_on_both_feet[person])


def _is_visible_joint(estimates: Estimates, person: int) -> BoolArray:
    """Return which joints (55,) of a person any photo shows; all, if the backend does not say."""
    observed = estimates.bodies.observed
    if observed is None:
        return np.ones(55, bool)
    from physic_core.geometry.tensors import exact_arrays

    others = exact_arrays(*(view.observed[person] for view in estimates.views))
    return np.asarray(np.any([observed[person], *others], axis=0))
