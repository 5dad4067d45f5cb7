"""Find people who stand: the legs are visible, at least one leg is straight, and the trunk is upright.

The rule is that of :func:`physic_core.body.posture.legs_in_line`, for 2D keypoints and for fitted 3D joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.posture import legs_in_line, standing_legs
from physic_core.types.skeletons import SIDES
from physic_embedded.body_fit.limb_keypoints import keypoint_indices, limb_keypoints

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from physic_core.types import Keypoints

    FloatArray = NDArray[np.floating]
    BoolArray = NDArray[np.bool_]

_MIN_CONFIDENCE = 0.5  # of a visible keypoint

MAX_BEND_IN_PICTURE_DEG = 25.0
"""Largest bend of a body that stands, in the picture, where limbs that point towards the camera look straight."""


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
    return np.asarray(standing_legs(joints).any(1) & (leg_confidence > _MIN_CONFIDENCE))


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
    ankle = np.maximum(points["left_ankle"][:, 1], points["right_ankle"][:, 1])
    nose = points["nose"][:, 1]
    legs = legs_in_picture(points, up=np.array([0.0, -1.0]))
    stands = visible & legs.any(1) & (nose < ankle)
    return tuple(StandingPerson(float(n), float(a)) for n, a in zip(nose[stands], ankle[stands], strict=True))


def legs_in_picture(points: Mapping[str, FloatArray], up: FloatArray | None = None) -> BoolArray:
    """Return which legs people stand on in the picture, (N, 2) bool, left and right.

    Args:
        points: (N, 2) px of shoulders, hips, knees and ankles, by name.
        up: (2,) in the picture; None if it is unknown.
    """
    shoulders, hips, knees, ankles = (
        np.stack([points[f"{side}_{joint}"] for side in SIDES], 1) for joint in ("shoulder", "hip", "knee", "ankle")
    )
    return legs_in_line(hips, knees, ankles, neck=shoulders.mean(1), up=up, max_deg=MAX_BEND_IN_PICTURE_DEG)
