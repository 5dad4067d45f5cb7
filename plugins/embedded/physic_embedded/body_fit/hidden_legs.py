"""Legs that the photo does not show: where knees and ankles are, and how upright the trunk is.

A pose network places the legs that a table or the border of the picture hides at the end of what is
seen, as if the person crouched, and leans the trunk towards the camera. The person observer says
whether the person sits. The trunk has two witnesses, the landmarks and the posture: people who
stand hold it upright, and people who sit nearly so.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.types import POSTURES, SEEN_CONFIDENCE, SIDES, SURE_CONFIDENCE, Observations
from physic_embedded.body_fit.limb_keypoints import keypoint_indices
from physic_embedded.body_fit.observations import LEAST_WORLD_WEIGHT

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Skeleton
    from physic_embedded.body_fit.observations import BodyObservations


_SURELY_HIDDEN = 0.25  # up to this confidence, trunk and hips are as without any legs
_GUESSED = 0.05  # up to this confidence, or outside the picture, a keypoint is a guess
_LEG = ("knee", "ankle", "heel", "foot_tip", "big_toe", "small_toe")
_THIGH_M, _SHANK_M = 0.4, 0.4
_BENDS_DEG = {
    **dict.fromkeys(("stand", "walk"), (0.0, 0.0)),
    "run": (35.0, 50.0),
    **dict.fromkeys(("sit", "ride"), (80.0, 80.0)),
    "squat": (110.0, 115.0),
    "kneel": (50.0, 85.0),
    "lie": (15.0, 20.0),
    "jump": (40.0, 50.0),
}
"""Posture -> bend of hips and of knees that the photo does not show."""
_SEATED_POSTURES = ("sit", "ride")
_PITCH_SIGMA_DEG = {
    **dict.fromkeys(("stand", "walk"), 12.0),
    **dict.fromkeys(("sit", "run", "ride", "jump"), 20.0),
    **dict.fromkeys(("kneel", "squat"), 30.0),
    "lie": 90.0,
}
"""Posture -> standard deviation of the trunk's pitch from the vertical."""

_HIPS_WITHOUT_LEGS = 0.05  # of the weight of hips in the picture: networks place them too high
_LANDMARK_PITCH_DEG = 30.0  # standard deviation of the trunk's pitch by landmarks without legs
_LEAST_UPRIGHT = 0.5  # cosine between trunk and vertical, below which people may lie


def has_hidden_legs(observations: BodyObservations, skeleton: Skeleton) -> BoolArray:
    """Return which of N people have no visible knee and ankle, (N,) bool."""
    return _leg_confidence(observations, skeleton) < SURE_CONFIDENCE


def _leg_confidence(observations: BodyObservations, skeleton: Skeleton) -> FloatArray:
    """Return the largest confidence (N,) of knees and ankles."""
    row = keypoint_indices(skeleton)
    ends = [row[f"{side}_{joint}"] for side in SIDES for joint in ("knee", "ankle")]
    return np.asarray(observations.confidence[:, ends].max(1, initial=0.0))


def with_hidden_legs(
    observations: BodyObservations,
    skeleton: Skeleton,
    person_observations: Observations,
    up: FloatArray,
) -> BodyObservations:
    """Return observations with 3D landmarks in place of the legs that the photo does not show, and
    trunks above them that are as upright as the posture makes likely.

    The legs are bent as the observer says, else as the postures make likely; without any, they hang
    straight down. What the network sees of the legs of people who sit is kept if it is no mere
    guess. Without 3D landmarks, only mere guesses are dropped.

    Args:
        observations: of N people.
        skeleton: joint set of the keypoints.
        person_observations: by the person observer.
        up: (3,) unit vector, camera frame.
    """
    row = keypoint_indices(skeleton)
    legs = [row[f"{side}_{name}"] for side in SIDES for name in _LEG if f"{side}_{name}" in row]
    hips = [row[f"{side}_hip"] for side in SIDES]
    leg_confidence = _leg_confidence(observations, skeleton)
    weight = observations.weight.copy()
    if observations.world is None:
        weight[:, legs] = np.where(leg_confidence[:, None] <= _GUESSED, 0.0, weight[:, legs])
        return replace(observations, weight=weight)
    world = observations.world.copy()
    world_weight = observations.world_weight.copy()
    sits = _probably_sits(person_observations)
    unsaid = np.isnan(person_observations.posture[:, 0])
    sigma = pitch_sigma(person_observations)
    bends = _expected_bends(person_observations)
    for i in map(int, np.flatnonzero(leg_confidence < SURE_CONFIDENCE)):
        up_in_view = observations.turn[i].T @ up  # in the axes of the view
        lies = person_observations.posture[i, POSTURES.index("lie")] > 0.5
        if lies or (unsaid[i] and -_trunk_direction(world[i], row) @ up_in_view < _LEAST_UPRIGHT):
            continue
        share = min(1.0, (SURE_CONFIDENCE - leg_confidence[i]) / (SURE_CONFIDENCE - _SURELY_HIDDEN))
        world[i] = _turned_upright(world[i], row, up_in_view, sigma[i], share)
        weight[i, hips] *= 1 - share * (1 - _HIPS_WITHOUT_LEGS)
        if leg_confidence[i] > (_GUESSED if sits[i] else SEEN_CONFIDENCE):
            continue
        weight[i, legs] = world_weight[i, legs] = 0
        for joint, position in _bent_leg_positions(world[i], row, -up_in_view, bends[i]).items():
            world[i, joint] = position
            world_weight[i, joint] = LEAST_WORLD_WEIGHT
    return replace(observations, weight=weight, world=world, world_weight=world_weight)


def without_guessed_legs(
    observations: BodyObservations,
    skeleton: Skeleton,
    person_observations: Observations,
    up: FloatArray,
    legs: BoolArray,
) -> BodyObservations:
    """Return observations in which legs (N, 2) bend as the posture says where the picture does not
    show knee or ankle; other arguments as of :func:`with_hidden_legs`.
    """
    if observations.world is None:
        return observations
    row = keypoint_indices(skeleton)
    weight = observations.weight.copy()
    world = observations.world.copy()
    world_weight = observations.world_weight.copy()
    bends = _expected_bends(person_observations)
    for i, k in np.argwhere(legs):
        ends = [row[f"{SIDES[k]}_{joint}"] for joint in ("knee", "ankle")]
        if observations.confidence[i, ends].min() >= SURE_CONFIDENCE:
            continue
        leg = [row[f"{SIDES[k]}_{name}"] for name in _LEG if f"{SIDES[k]}_{name}" in row]
        weight[i, leg] = world_weight[i, leg] = 0
        positions = _bent_leg_positions(world[i], row, -observations.turn[i].T @ up, bends[i])
        for joint in ends:
            world[i, joint] = positions[joint]
            world_weight[i, joint] = LEAST_WORLD_WEIGHT
    return replace(observations, weight=weight, world=world, world_weight=world_weight)


def pitch_sigma(person_observations: Observations) -> FloatArray:
    """Return the standard deviation (N,) of the trunk's pitch from the vertical by the posture,
    radians; that of the usual postures where nothing is said.
    """
    variance = np.square(np.radians([_PITCH_SIGMA_DEG[name] for name in POSTURES]))
    usual = np.radians(_PITCH_SIGMA_DEG["sit"]) ** 2
    mixed = person_observations.posture.astype(np.float64) @ variance
    return np.sqrt(np.where(np.isnan(mixed), usual, mixed))


def _probably_sits(person_observations: Observations) -> BoolArray:
    """Return which of N people probably sit, (N,) bool."""
    seated = [POSTURES.index(name) for name in _SEATED_POSTURES]
    return np.asarray(np.nan_to_num(person_observations.posture[:, seated].sum(1)) > 0.5)


def _expected_bends(person_observations: Observations) -> FloatArray:
    """Return the bends (N, 4) of left hip, right hip, left knee and right knee by the postures,
    radians; 0 where nothing is said.

    Postures count by their squared probabilities, since legs between two postures are unlikely.
    """
    share = np.nan_to_num(person_observations.posture.astype(np.float64)) ** 2
    share /= share.sum(1, keepdims=True) + 1e-9
    usual = np.repeat(share @ np.array([_BENDS_DEG[name] for name in POSTURES]), 2, axis=1)
    return np.asarray(np.radians(usual))


def _turned_upright(
    world: FloatArray, row: dict[str, int], direction_up: FloatArray, sigma: float, share: float
) -> FloatArray:
    """Return 3D landmarks (J, 3) of one person turned about the hips by a share of the way from the
    pitch of their trunk to the mean of that and of the vertical by their standard deviations.
    """
    trunk = -_trunk_direction(world, row)
    pitch = np.arctan2(trunk[2], -trunk[1]) - np.arctan2(direction_up[2], -direction_up[1])
    turn = -share * pitch / (1 + (sigma / np.radians(_LANDMARK_PITCH_DEG)) ** 2)
    cos, sin = np.cos(turn), np.sin(turn)
    about_x = np.array([[1, 0, 0], [0, cos, sin], [0, -sin, cos]])
    return np.asarray(world @ about_x.T)


def _bent_leg_positions(
    world: FloatArray, row: dict[str, int], down: FloatArray, bends: FloatArray
) -> dict[int, FloatArray]:
    """Return places (3,) of knees and ankles of one person with 3D landmarks (J, 3), by row of the
    landmark.

    Args:
        world: metres, the origin between the hips.
        row: of each landmark, by name.
        down: (3,) unit vector.
        bends: (4,) of left hip, right hip, left knee and right knee, radians.
    """
    ahead = np.cross(down, world[row["left_hip"]] - world[row["right_hip"]])
    ahead /= np.linalg.norm(ahead) + 1e-9
    positions = {}
    for k, side in enumerate(SIDES):
        thigh, shank = bends[k], bends[k] - bends[2 + k]
        knee = world[row[f"{side}_hip"]] + _THIGH_M * (np.sin(thigh) * ahead + np.cos(thigh) * down)
        positions[row[f"{side}_knee"]] = knee
        positions[row[f"{side}_ankle"]] = knee + _SHANK_M * (
            np.sin(shank) * ahead + np.cos(shank) * down
        )
    return positions


def _trunk_direction(world: FloatArray, row: dict[str, int]) -> FloatArray:
    """Return the unit vector (3,) from shoulders to hips of 3D landmarks (J, 3)."""
    trunk = _pair_center(world, row, "hip") - _pair_center(world, row, "shoulder")
    return trunk / (np.linalg.norm(trunk) + 1e-9)


def _pair_center(points: FloatArray, row: dict[str, int], joint: str) -> FloatArray:
    """Return the middle of the left and the right joint among points (J, n)."""
    return np.asarray((points[row[f"left_{joint}"]] + points[row[f"right_{joint}"]]) / 2)
