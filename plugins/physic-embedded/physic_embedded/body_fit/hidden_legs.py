"""Legs that the photo does not show: whether their owner sits, and where knees and ankles are.

A pose network places the legs that a table or the border of the picture hides at the end of what is
seen, as if the person crouched. How high the shoulders are over the floor tells more, and the floor
needs no scale for that: the size of the person says how far away the pixels of the person are.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_embedded.body_fit.limb_keypoints import keypoint_indices
from physic_embedded.body_fit.observations import LEAST_WORLD_WEIGHT
from physic_embedded.body_fit.start import translation_from_points

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Hints, Intrinsics, People, Skeleton
    from physic_embedded.body_fit.observations import BodyObservations

    FloatArray = NDArray[np.floating]

_HIDDEN = 0.3  # legs whose knees and ankles all have less confidence are hidden
_GUESSED = 0.05  # up to this confidence, or outside the picture, a keypoint is a guess
_LEG = ("knee", "ankle", "heel", "foot_tip", "big_toe", "small_toe")
_HANGING = {"knee": (0.0, 0.4), "ankle": (0.0, 0.8)}
_SEATED = {"knee": (0.4, 0.05), "ankle": (0.4, 0.45)}
"""Joint -> metres before and under the hip, of people who stand and of people on a seat."""

# Log odds of sitting, fitted to 65 people with hidden legs in 51 labelled photos and their final
# floors. Of half "held", 85 % are right by a fit to half "development". Over the floor that pixels
# alone give, shoulders are .27 m lower (14 people in 5 photos): the middle is lowered by that.
_CONSTANT = -0.47
_PER_METRE = -7.2  # of the height of the shoulders
_PER_RADIAN = 2.2  # of the bend at the hips that the network sees
_MIDDLE_HEIGHT_M = 0.81
_MIDDLE_BEND = 0.7
_BENDS = (0.2, 1.4)  # radians; legs that the network bends further are crouched, not on a seat
_MOST_HEIGHT_M = 0.3  # largest difference from the middle that counts
_MAX_HEIGHT_M = 1.5  # of shoulders; higher, the floor is another one's
_STRAIGHT = 0.8  # radians at the hips, below which people do not sit by the network
_LEAST_UPRIGHT = 0.5  # cosine between trunk and vertical; people who lie keep their legs
_PATCH = 0.25  # of the trunk's length in the picture, around the shoulders


def with_hidden_legs(
    observations: BodyObservations,
    people: People,
    skeleton: Skeleton,
    intrinsics: Intrinsics,
    hints: Hints,
) -> BodyObservations:
    """Return observations with 3D landmarks in place of the legs that the photo does not show.

    They hang straight down, or are those of people on a seat. What the network sees of the legs of
    people who sit is kept if it is no mere guess. Without 3D landmarks, only mere guesses are
    dropped.

    Args:
        observations: of N people.
        people: their masks.
        skeleton: joint set of the keypoints.
        intrinsics: of the photo.
        hints: floor, and point map of the original photo; without them, the landmarks decide.
    """
    row = keypoint_indices(skeleton)
    ends = [row[f"{side}_{joint}"] for side in ("left", "right") for joint in ("knee", "ankle")]
    legs = [
        row[f"{side}_{name}"]
        for side in ("left", "right")
        for name in _LEG
        if f"{side}_{name}" in row
    ]
    seen = observations.confidence[:, ends].max(1, initial=0.0)
    weight = observations.weight.copy()
    if observations.world is None:
        weight[np.ix_(seen <= _GUESSED, legs)] = 0
        return replace(observations, weight=weight)
    world = observations.world.copy()
    world_weight = observations.world_weight.copy()
    for i in map(int, np.flatnonzero(seen < _HIDDEN)):
        trunk = _trunk(world[i], row)
        down = observations.turn[i][1]  # the camera's y axis in the axes of the view
        if trunk @ down < _LEAST_UPRIGHT:
            continue
        bend = _bend_at_hips(world[i], row, trunk)
        height = _height_of_shoulders(observations, people, i, row, legs, intrinsics, hints)
        odds = _CONSTANT + _PER_RADIAN * (np.clip(bend, *_BENDS) - _MIDDLE_BEND)
        if height < _MAX_HEIGHT_M:
            beyond = np.clip(height - _MIDDLE_HEIGHT_M, -_MOST_HEIGHT_M, _MOST_HEIGHT_M)
            odds += _PER_METRE * beyond
        sits = odds > 0
        if sits and seen[i] > _GUESSED and bend > _STRAIGHT:
            continue
        weight[i, legs] = world_weight[i, legs] = 0
        places = _places_of_legs(world[i], row, down, _SEATED if sits else _HANGING)
        for joint, place in places.items():
            world[i, joint] = place
            world_weight[i, joint] = LEAST_WORLD_WEIGHT
    return replace(observations, weight=weight, world=world, world_weight=world_weight)


def _places_of_legs(
    world: FloatArray, row: dict[str, int], down: FloatArray, legs: dict[str, tuple[float, float]]
) -> dict[int, FloatArray]:
    """Return places (3,) of knees and ankles of one person with 3D landmarks (J, 3), by row of the
    landmark.
    """
    ahead = np.cross(down, world[row["left_hip"]] - world[row["right_hip"]])
    ahead /= np.linalg.norm(ahead) + 1e-9
    return {
        row[f"{side}_{name}"]: world[row[f"{side}_hip"]] + before * ahead + under * down
        for side in ("left", "right")
        for name, (before, under) in legs.items()
    }


def _trunk(world: FloatArray, row: dict[str, int]) -> FloatArray:
    """Return the unit vector (3,) from shoulders to hips of 3D landmarks (J, 3)."""
    trunk = _middle(world, row, "hip") - _middle(world, row, "shoulder")
    return np.asarray(trunk / (np.linalg.norm(trunk) + 1e-9))


def _bend_at_hips(world: FloatArray, row: dict[str, int], trunk: FloatArray) -> float:
    """Return the mean angle between a trunk (3,) and the thighs of 3D landmarks (J, 3), radians."""
    bends = []
    for side in ("left", "right"):
        thigh = world[row[f"{side}_knee"]] - world[row[f"{side}_hip"]]
        bends.append(np.arccos(np.clip(thigh @ trunk / (np.linalg.norm(thigh) + 1e-9), -1, 1)))
    return float(np.mean(bends))


def _height_of_shoulders(
    observations: BodyObservations,
    people: People,
    person: int,
    row: dict[str, int],
    legs: list[int],
    intrinsics: Intrinsics,
    hints: Hints,
) -> float:
    """Return the height of the shoulders of one person over the floor, metres; NaN if unknown."""
    if hints.floor is None or hints.original is None or observations.world is None:
        return np.nan
    points = observations.points[person]
    shoulders = _middle(points, row, "shoulder")
    reach = _PATCH * float(np.linalg.norm(_middle(points, row, "hip") - shoulders))
    x0, y0 = np.maximum(shoulders - reach, 0).astype(int)
    x1, y1 = np.maximum(shoulders + reach + 1, 0).astype(int)
    patch = (slice(y0, y1), slice(x0, x1))
    depths = hints.original.points[patch][people.masks[person][patch], 2]
    depths = depths[np.isfinite(depths)]
    landmarks = observations.world[person] @ observations.turn[person].T
    weight = observations.confidence[person].copy()
    weight[legs] = 0
    moved = translation_from_points(landmarks, points, weight, intrinsics.matrix)
    if moved is None or not len(depths):
        return np.nan
    place = _middle(landmarks, row, "shoulder") + moved
    scale = place[2] / max(float(np.median(depths)), 1e-9)
    return float(place @ hints.floor.normal + scale * hints.floor.offset)


def _middle(points: FloatArray, row: dict[str, int], joint: str) -> FloatArray:
    """Return the middle of the left and the right joint among points (J, n)."""
    return np.asarray((points[row[f"left_{joint}"]] + points[row[f"right_{joint}"]]) / 2)
