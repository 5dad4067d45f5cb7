"""Legs of people who surely stand or sit, by the person observer: straight, or with level thighs.

3D landmarks of single-person networks fold legs in depth, where the picture shows little of it:
people who stand crouch, and people who sit half stand. Of 123 people who stand by the observer, 13
had both knees bent by over 25 degrees, and strict readers found one in five of such poses right.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import JOINT_INDEX, joint_pair
from physic_core.types import POSTURES, SIDES, SURE_CONFIDENCE
from physic_embedded.body_fit.fit_problem import LegsByPosture
from physic_embedded.body_fit.initial_pose import bent_leg
from physic_embedded.body_fit.limb_keypoints import sided_indices

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Observations
    from physic_embedded.body_fit.fit_problem import InitialPose
    from physic_embedded.body_fit.observations import BodyObservations


_LEG = ("hip", "knee", "ankle")
_SURE = 0.85  # least probability of the posture
_LIMITS = {"stand": (0.97, 0.08, 0.94, 0.12), "sit": (0.25, -0.12, 0.0, np.inf)}
"""Posture -> limit and standard deviation of the cosines between thigh and vertical and between
shank and thigh, as in :class:`LegsByPosture`. Who stands may rest one leg: 20 degrees, 45 of the
knee, cost little. Thighs of people who sit lie between level and raised.
"""
# Standard deviations beyond the limit of legs that start again in the posture: of both, or of one.
_BOTH_FAR, _ONE_FAR = 1.0, 2.0
_STANDING = 0.7  # limit of the cosine from which on a posture's legs are straight
_SHOWN_BEND = np.radians(25.0)  # of a knee in the picture, which is real


def legs_by_posture(person_observations: Observations) -> LegsByPosture:
    """Return where the legs of N people lie by their postures."""
    cosine = np.zeros((len(person_observations), 2))
    sigma = np.full((len(person_observations), 2), np.inf)
    for name, (thigh, thigh_sigma, shank, shank_sigma) in _LIMITS.items():
        sure = person_observations.posture[:, POSTURES.index(name)] > _SURE
        cosine[sure] = thigh, shank
        sigma[sure] = thigh_sigma, shank_sigma
    return LegsByPosture(cosine, sigma)


def legs_of_other_postures(
    joints: FloatArray, observations: BodyObservations, up: FloatArray, legs: LegsByPosture
) -> BoolArray:
    """Return which left and right legs (N, 2) lie far from their posture: both legs of a person, or
    one whose knee the picture does not show. None of who stands on a leg that is bent in the
    picture.

    Args:
        joints: (N, 55, 3) of fitted bodies, camera frame.
        observations: that they were fitted to.
        up: (3,) camera frame.
        legs: by the postures.
    """
    hips, knees, ankles = (joints[:, joint_pair(name)] for name in _LEG)
    thigh, shank = _unit(knees - hips), _unit(ankles - knees)
    cosines = np.stack([-(thigh @ up), (thigh * shank).sum(-1)], -1)
    beyond = ((legs.cosine[:, None] - cosines) / legs.sigma[:, None]).max(-1)
    both = (beyond > _BOTH_FAR).all(1)
    columns = [sided_indices(observations.skeleton, name) for name in _LEG]
    points = [observations.points[:, rows] for rows in columns]
    flat_thigh, flat_shank = _unit(points[1] - points[0]), _unit(points[2] - points[1])
    is_straight = (flat_thigh * flat_shank).sum(-1) < np.cos(_SHOWN_BEND)
    is_visible = observations.confidence[:, columns[1]] >= SURE_CONFIDENCE
    is_straight &= is_visible & (observations.confidence[:, columns[2]] >= SURE_CONFIDENCE)
    bent = (is_straight & (beyond > _BOTH_FAR)).any(1) & (legs.cosine[:, 0] > _STANDING)
    return np.asarray((both[:, None] | (~is_visible & (beyond > _ONE_FAR))) & ~bent[:, None])


def without_posture(legs: LegsByPosture, people: BoolArray) -> LegsByPosture:
    """Return the same without what is known of some people (N,)."""
    return legs._replace(sigma=np.where(people[:, None], np.inf, legs.sigma))


def with_legs(
    start: InitialPose, joints: FloatArray, posed: BoolArray, up: FloatArray, legs: LegsByPosture
) -> InitialPose:
    """Return initial poses in which some left and right legs (N, 2) lie in their posture. Straight
    legs keep where the ankles of ``joints`` (N, 55, 3) are, but for what is ahead or behind.
    """
    pose = start.pose.copy()
    for i, k in np.argwhere(posed):
        root = start.root[i]
        ahead = _unit(root[:, 2] - (root[:, 2] @ up) * up)
        cosine = legs.cosine[i, 0]
        if cosine > _STANDING:
            hip, ankle = (joints[i, JOINT_INDEX[f"{SIDES[k]}_{end}"]] for end in ("hip", "ankle"))
            thigh = shank = _unit(ankle - hip - ((ankle - hip) @ ahead) * ahead)
        else:
            thigh, shank = np.sqrt(1 - cosine**2) * ahead - cosine * up, -up
        hip_turn, bend = bent_leg(thigh, shank, root)
        pose[i, JOINT_INDEX[f"{SIDES[k]}_hip"] - 1] = hip_turn
        pose[i, JOINT_INDEX[f"{SIDES[k]}_knee"] - 1] = bend, 0, 0
    return replace(start, pose=pose)


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / (np.linalg.norm(vectors, axis=-1, keepdims=True) + 1e-9))
