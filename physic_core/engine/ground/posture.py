"""What people do, by the person observer and the axis of the trunk in the picture: who lies, and
who is upright, of whom alone it is asked how far they lean; and who is seen from behind.

Each witness can be wrong alone. The observer calls people who lie "sit" or "stand", and the trunk
of a person who lies away from the camera points up in the picture.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.types.observations import LEAST_PROBABILITY, POSTURES
from physic_core.types.skeletons import SEEN_CONFIDENCE, SIDES

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Intrinsics, Keypoints, Observations

_UPRIGHT_POSTURES = ("stand", "walk", "run", "sit", "ride")
# Probability from which on people stand or walk: 101 of 117 are labelled so. At .5 to .7 people
# lean by up to 28 degrees.
_STANDS = 0.7
UPRIGHT_DEG = 45.0
"""Largest angle of an upright trunk from up in the picture."""

# Of people whose trunk points to the side or down: rounded counts of 67 pictures of exercises and
# 94 everyday photos. Planks and push-ups, which no posture names, are left out.
_ACROSS = {"lie": 0.8, "sit": 0.08, "kneel": 0.04, "squat": 0.03, "jump": 0.03}
_ACROSS_OTHERS = 0.005
_ACROSS_DEG = (30.0, 70.0)  # angles of trunks that surely do not, and surely do
# Of those whose trunk does, but one of whose legs carries the hips: a guess, one of the 67 is such.
_BENT = {"stand": 0.8, "squat": 0.06, "lie": 0.05}
# Lengths of a leg from which on its knee is so far below the hips, and its ankle: of the 67, bars
# and benches on which people lie with their feet on the floor are lower.
_KNEE_BELOW = 0.3
_ANKLE_BELOW = 0.7
_LEAST_SHARE = 1e-4  # of a posture
_TURNED_TO_CAMERA = 0.5  # cosine of the angle by which shoulders and hips differ from the view's
# Evidence that outweighs such keypoints of the embedded detector: 12 of 361 people who had them are
# seen from behind. Chosen on one collection, reported on another (benchmarks/README.md); the angle
# above rests on the same 12 people of all collections.
_BACK = 3.4


def keypoints_by_side(keypoints: Keypoints, *joints: str) -> tuple[FloatArray, FloatArray]:
    """Return the left and right keypoints of J joints of N people: points (N, J, 2, 2) px and
    confidence (N, J, 2); NaN and 0 of those that the skeleton lacks.
    """
    columns = {name: j for j, name in enumerate(keypoints.joint_set.names)}
    shape = (len(keypoints.points), len(joints), 2)
    points = np.full((*shape, 2), np.nan, keypoints.points.dtype)
    confidence = np.zeros(shape, keypoints.confidence.dtype)
    for at in np.ndindex(shape[1:]):
        column = columns.get(f"{SIDES[at[1]]}_{joints[at[0]]}")
        if column is not None:
            points[:, *at] = keypoints.points[:, column]
            confidence[:, *at] = keypoints.confidence[:, column]
    return points, confidence


def weigh_posture(observations: Observations, keypoints: Keypoints) -> Observations:
    """Return observations of N people whose posture is weighed by the axis of the trunk: the share
    of each posture in the fitted data gives way to that of people whose trunk points to the side,
    and whose legs carry the hips or do not.

    Args:
        said: of the people.
        keypoints: of the same people.
    """
    axis = np.abs(trunk_image_angle_deg(keypoints))
    low, high = _ACROSS_DEG
    across = np.nan_to_num(np.clip((axis - low) / (high - low), 0, 1))[:, None]
    usual, bent = (
        np.array([shares.get(name, _ACROSS_OTHERS) for name in POSTURES])
        for shares in (_ACROSS, _BENT)
    )
    usual = np.where(_has_standing_leg(keypoints)[:, None], bent / bent.sum(), usual / usual.sum())
    share = np.maximum(observations.posture_share.astype(np.float64), _LEAST_SHARE)
    prior = (1 - across) * share + across * usual
    posture = observations.posture * prior / share
    posture /= posture.sum(1, keepdims=True)
    return replace(observations, posture=posture.astype(np.float32))


def _has_standing_leg(keypoints: Keypoints) -> BoolArray:
    """Return who of N people has a seen leg far below the hips in the picture (N,)."""
    points, confidence = keypoints_by_side(keypoints, "hip", "knee", "ankle")
    points = points.astype(np.float64)
    visible = confidence.min(1) >= SEEN_CONFIDENCE
    length = np.linalg.norm(np.diff(points, axis=1), axis=-1).sum(1).max(1)
    below = points[..., 1] - points[:, :1, :, 1].mean(2, keepdims=True)
    knee, ankle = (below[:, i] / (length[:, None] + 1e-9) for i in (1, 2))
    return np.asarray((visible & (knee > _KNEE_BELOW) & (ankle > _ANKLE_BELOW)).any(1))


def seems_reversed(observations: Observations, keypoints: Keypoints) -> BoolArray:
    """Return who of N people (N,) is likely seen from behind, while the 3D keypoints face the
    camera: pose networks guess the face that a head hides.

    Args:
        said: of the people.
        keypoints: of the same people.
    """
    names = keypoints.joint_set.names
    ends = [f"{side}_{joint}" for joint in ("shoulder", "hip") for side in SIDES]
    if keypoints.world is None or not set(ends) <= set(names):
        return np.zeros(len(keypoints.points), bool)
    a, b, c, d = (keypoints.world[:, names.index(end)] for end in ends)
    x, _, z = (a - b + c - d).T
    return np.asarray(
        (x > _TURNED_TO_CAMERA * np.hypot(x, z)) & (observations.evidence("away") > _BACK)
    )


def is_upright(keypoints: Keypoints, observations: Observations) -> BoolArray:
    """Return who of N people is upright (N,), unless picture or observer says otherwise.

    Args:
        keypoints: of the people.
        said: of the same people.
    """
    axis = trunk_image_angle_deg(keypoints)
    postures = [POSTURES.index(name) for name in _UPRIGHT_POSTURES]
    likely = observations.posture[:, postures].sum(1)
    return np.asarray(~(np.abs(axis) > UPRIGHT_DEG) & ~(likely < LEAST_PROBABILITY))


def may_rest_on_any_skin(keypoints: Keypoints, observations: Observations) -> BoolArray:
    """Return who of N people lies, planks or is on all fours (N,), and so may rest on any part: by
    the trunk in the picture, or by the observer.

    Args:
        keypoints: of the people.
        said: of the same people.
    """
    trunk_visible = (
        keypoints_by_side(keypoints, "shoulder", "hip")[1].min((1, 2)) >= SEEN_CONFIDENCE
    )
    across = trunk_visible & (np.abs(trunk_image_angle_deg(keypoints)) > UPRIGHT_DEG)
    return np.asarray(across | (observations.posture[:, POSTURES.index("lie")] > LEAST_PROBABILITY))


def is_surely_standing(observations: Observations) -> BoolArray:
    """Return which of N people surely stand or walk by the observer, (N,) bool."""
    postures = [POSTURES.index(name) for name in ("stand", "walk")]
    return np.asarray(observations.posture[:, postures].sum(1) > _STANDS)


def trunk_planes_of_standing(
    keypoints: Keypoints, observations: Observations, camera: Intrinsics
) -> FloatArray:
    """Return the unit normals (M, 3) of the planes through the camera and the trunks of those who
    stand or walk by the observer, whichever way they point.

    Args:
        keypoints: of N people.
        said: of the same people.
        camera: of the photo.
    """
    points, confidence = keypoints_by_side(keypoints, "shoulder", "hip")
    stands = is_surely_standing(observations)
    stands &= confidence.min((1, 2)) >= SEEN_CONFIDENCE
    pixels = points[stands].reshape(-1, 4, 2).astype(np.float64)
    rays = np.concatenate([pixels, np.ones((*pixels.shape[:2], 1))], 2)
    rays = rays @ np.linalg.inv(camera.matrix).T
    normals = np.cross(rays[:, :2].mean(1), rays[:, 2:].mean(1))
    return np.asarray(normals / (np.linalg.norm(normals, axis=1, keepdims=True) + 1e-12))


def trunk_image_angle_deg(keypoints: Keypoints) -> FloatArray:
    """Return the angle (N,) from up in the picture to the line from hips to shoulders, degrees in
    (-180, 180], clockwise; NaN where a joint is unknown.
    """
    middles = keypoints_by_side(keypoints, "shoulder", "hip")[0].mean(2, dtype=np.float64)
    trunk = middles[:, 0] - middles[:, 1]
    return np.asarray(np.degrees(np.arctan2(trunk[:, 0], -trunk[:, 1])))
