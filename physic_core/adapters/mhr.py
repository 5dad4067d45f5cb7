"""Convert the 70 keypoints of MHR bodies ("MHR70": SAM 3D Body, InstantHMR) to SMPL-X joints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.joints import JOINT_INDEX, NUM_JOINTS

if TYPE_CHECKING:
    from physic_core.types import FloatArray

NUM_KEYPOINTS = 70
_BODY = {"shoulder": 5, "elbow": 7, "hip": 9, "knee": 11, "ankle": 13}
"""First of the two keypoints, left then right, of what both bodies have."""
_EYES = {"left_eye": 1, "right_eye": 2}
_WRIST = {"left": 62, "right": 41}
_FIRST_FINGER = {"left": 42, "right": 21}
_FINGERS = ("thumb", "index", "middle", "ring", "pinky")
_FOOT = {"left": (13, 15, 16), "right": (14, 18, 19)}
"""Keypoints of the ankle and the tips of the big and the small toe, whose weighted mean is the ball of the foot."""
_BALL = np.array([0.2, 0.4, 0.4], np.float32)
"""Weights of that mean: on worlds it is 5 mm off on average, and 31 mm with bent toes."""


def _table() -> dict[int, int]:
    """Return the SMPL-X joint of each keypoint that has one.

    Fingers are sorted from the thumb, each from its tip: tip, "first", "second", "third joint". The third is the
    knuckle, SMPL-X's first. The neck is omitted because it is another point; so are olecranon, fossa and acromion.
    """
    table = {number: JOINT_INDEX[name] for name, number in _EYES.items()}
    for name, number in _BODY.items():
        table |= {number: JOINT_INDEX[f"left_{name}"], number + 1: JOINT_INDEX[f"right_{name}"]}
    for side, first in _FIRST_FINGER.items():
        table[_WRIST[side]] = JOINT_INDEX[f"{side}_wrist"]
        for i, finger in enumerate(_FINGERS):
            tip = first + 4 * i
            table |= {tip + 4 - k: JOINT_INDEX[f"{side}_{finger}{k}"] for k in (1, 2, 3)}
    return table


JOINT_BY_KEYPOINT = _table()
"""SMPL-X joint by MHR keypoint."""


def joints_from_keypoints(keypoints: FloatArray) -> FloatArray:
    """Convert keypoints (N, 70, 3) to SMPL-X joints (N, 55, 3) float32; NaN for joints without a keypoint."""
    joints = np.full((len(keypoints), NUM_JOINTS, 3), np.nan, np.float32)
    joints[:, list(JOINT_BY_KEYPOINT.values())] = keypoints[:, list(JOINT_BY_KEYPOINT)]
    for side, points in _FOOT.items():
        joints[:, JOINT_INDEX[f"{side}_foot"]] = np.einsum("k,nki->ni", _BALL, keypoints[:, list(points)])
    return joints
