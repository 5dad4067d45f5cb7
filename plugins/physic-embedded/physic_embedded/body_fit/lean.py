"""Who stands, and how far a body leans towards the camera.

3D landmarks of single-person networks lean towards the camera by 10 degrees and more. The picture cannot show it: the
joints project to the same pixels. The floor can: people who stand on straight legs have the neck over the ankles.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import JOINT_INDEX as INDEX

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.floating]
    BoolArray = NDArray[np.bool_]

__all__ = ["lean_towards_camera", "standing"]

_LEAST_KNEE_DEG = 147.0
_MOST_BEND_DEG = 35.0
_SEEN = 0.5


def standing(joints: FloatArray, leg_confidence: FloatArray) -> BoolArray:
    """Who stands: knees and ankles seen, at least one straight leg, trunk in line with the legs.

    Args:
        joints: (N, 55, 3), any frame.
        leg_confidence: (N,) the least of knees and ankles.

    Returns:
        (N,) bool.
    """
    knees = [
        _angle_deg(
            joints[:, INDEX[f"{side}_hip"]] - joints[:, INDEX[f"{side}_knee"]],
            joints[:, INDEX[f"{side}_ankle"]] - joints[:, INDEX[f"{side}_knee"]],
        )
        for side in ("left", "right")
    ]
    trunk = joints[:, INDEX["neck"]] - joints[:, INDEX["pelvis"]]
    legs = joints[:, INDEX["pelvis"]] - _ankles(joints)
    straight = np.maximum(*knees) > _LEAST_KNEE_DEG
    return np.asarray(straight & (_angle_deg(trunk, legs) < _MOST_BEND_DEG) & (leg_confidence > _SEEN))


def lean_towards_camera(joints: FloatArray, turn: FloatArray, up: FloatArray) -> FloatArray:
    """Signed angle from the vertical to the line from ankles to neck, seen from the side of each person's view.

    Args:
        joints: (N, 55, 3) camera frame.
        turn: (N, 3, 3) from the axes of a camera that looks straight at the person to this camera's.
        up: (3,) camera frame.

    Returns:
        (N,) radians; positive leans towards the camera.
    """
    column = np.einsum("nij,ni->nj", turn, joints[:, INDEX["neck"]] - _ankles(joints))
    seen_up = np.einsum("nij,i->nj", turn, up)
    lean = np.arctan2(column[:, 2], -column[:, 1]) - np.arctan2(seen_up[:, 2], -seen_up[:, 1])
    return np.asarray(-((lean + np.pi) % (2 * np.pi) - np.pi))


def _ankles(joints: FloatArray) -> FloatArray:
    return (joints[:, INDEX["left_ankle"]] + joints[:, INDEX["right_ankle"]]) / 2


def _angle_deg(a: FloatArray, b: FloatArray) -> FloatArray:
    cosine = (a * b).sum(-1) / (np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1) + 1e-9)
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
