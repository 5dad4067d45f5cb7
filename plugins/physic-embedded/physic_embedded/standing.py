"""Find people who stand: the legs are visible, at least one leg is straight, and the trunk is upright.

The rule is the same for 2D keypoints and for fitted 3D joints. The limits are narrower in 2D, where limbs that point
towards the camera look straight.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.joints import JOINT_INDEX as INDEX
from physic_core.types.skeletons import SIDES
from physic_embedded.body_fit.limb_keypoints import keypoint_indices, limb_keypoints

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Keypoints

    FloatArray = NDArray[np.floating]
    BoolArray = NDArray[np.bool_]

_MIN_CONFIDENCE = 0.5  # of a visible keypoint


@dataclass(frozen=True)
class _Limits:
    """Largest angles of a standing person, degrees."""

    knee: float  # bend of the straighter knee
    trunk: float  # from the trunk to its reference direction


_LIMITS_2D = _Limits(knee=25.0, trunk=15.0)
_LIMITS_3D = _Limits(knee=33.0, trunk=35.0)


@dataclass(frozen=True)
class StandingPerson:
    """Image rows of the nose and the lower ankle of a standing person, px."""

    nose: float
    ankle: float


def standing_bodies(joints: FloatArray, leg_confidence: FloatArray) -> BoolArray:
    """Return which fitted bodies stand, (N,) bool.

    Args:
        joints: (N, 55, 3) SMPL-X joints, any frame.
        leg_confidence: (N,) lowest confidence of knees and ankles.
    """
    points = {name: joints[:, row] for name, row in INDEX.items()}
    trunk = points["neck"] - points["pelvis"]
    legs = points["pelvis"] - (points["left_ankle"] + points["right_ankle"]) / 2
    return np.asarray(_is_straight(points, trunk, legs, _LIMITS_3D) & (leg_confidence > _MIN_CONFIDENCE))


def standing_people(keypoints: Keypoints | None, height: int, width: int) -> tuple[StandingPerson, ...]:
    """Return the standing people whose 2D keypoints are visible from the nose to the ankles.

    Args:
        keypoints: of the photo, or None.
        height: of the photo, px.
        width: of the photo, px.
    """
    if keypoints is None or not len(keypoints.points):
        return ()
    keypoints = limb_keypoints(keypoints)
    row = keypoint_indices(keypoints.joint_set)
    needed = [row["nose"], *(row[f"{s}_{j}"] for s in SIDES for j in ("shoulder", "hip", "knee", "ankle"))]
    points = {name: keypoints.points[:, i] for name, i in row.items()}
    visible = keypoints.confidence[:, needed].min(1) >= _MIN_CONFIDENCE
    visible &= ((keypoints.points[:, needed] >= 0) & (keypoints.points[:, needed] < [width, height])).all((1, 2))
    line = (points["left_ankle"] + points["right_ankle"] - points["left_shoulder"] - points["right_shoulder"]) / 2
    ankle = np.maximum(points["left_ankle"][:, 1], points["right_ankle"][:, 1])
    nose = points["nose"][:, 1]
    stands = visible & _is_straight(points, line, np.array([0.0, 1.0]), _LIMITS_2D) & (nose < ankle)
    return tuple(StandingPerson(float(n), float(a)) for n, a in zip(nose[stands], ankle[stands], strict=True))


def angle_deg(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the angles between vectors (..., D) in degrees."""
    cosine = (a * b).sum(-1) / (np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1) + 1e-9)
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _is_straight(points: dict[str, FloatArray], trunk: FloatArray, reference: FloatArray, limits: _Limits) -> BoolArray:
    """Return whether the trunk is near its reference direction and at least one knee is straight, (N,) bool."""
    bends = [
        angle_deg(points[f"{side}_knee"] - points[f"{side}_hip"], points[f"{side}_ankle"] - points[f"{side}_knee"])
        for side in SIDES
    ]
    return np.asarray((angle_deg(trunk, reference) < limits.trunk) & (np.minimum(*bends) < limits.knee))
