"""Look again at people who are not upright, in squares that are turned.

The landmark network was trained on people whose head is up in its square. Of others it may swap
hips and head, and a square that follows these follows the error.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.engine.ground.posture import UPRIGHT_DEG
from physic_embedded.networks.crops import RotatedSquare
from physic_embedded.networks.pose import predict_pose_if_present

if TYPE_CHECKING:
    from collections.abc import Callable

    from physic_core.types import FloatArray
    from physic_embedded.networks.crops import ImagePyramid
    from physic_embedded.networks.pose import Pose
    from physic_networks.onnx_sessions import OnnxSession

SURE_FIT = 0.5
SURE_MIRROR_GAP = 0.02
"""Least fit and largest mirror gap of a sure pose, which no other pose changes."""
_UPRIGHT_GAP = 0.05  # largest mirror gap of an upright person
_UPRIGHT_WIDTH = 0.8
"""Largest width of the box of a person who is upright or upside down, over its height; and largest
height of the box of one who lies, over its width.
"""
_LEAST_FIRST_SCORE = 0.8
"""Score of the first look in a turned square from which the look goes on. Of the 57 poses that were
best in 314 photos, 54 have .9 or more; people look better without the others.
"""
# Of a pose in a turned square. Of 180 people in street and sport photos, poses beyond are wrong.
_LEAST_FIT = 0.3
_LARGEST_GAP = 0.04
# In mirror gaps. Of 758 joints of 72 people in 67 pictures of exercises, 253 are farther than a
# tenth of the box from where readers see them by the first look, and 61 by the chosen one; 69 where
# the weight of the fit is chosen on the other four fifths of the pictures.
_SCORE_WEIGHT = 0.05
_FIT_WEIGHT = 0.02


def square_around(box: FloatArray, angle: float = 0.0) -> RotatedSquare:
    """Return the square that the landmark network needs for a person in a box (4,), turned by an
    angle, radians clockwise.
    """
    center = np.array([(box[0] + box[2] - 1) / 2, (box[1] + box[3] - 1) / 2])
    side = max(float(box[2] - box[0]), float(box[3] - box[1]), 1.0)
    return RotatedSquare(center, 1.25 * side, angle)


def best_pose_of_turned_squares(
    landmarker: OnnxSession,
    picture: ImagePyramid,
    box: FloatArray,
    pose: Pose,
    fit: Callable[[Pose], float],
) -> Pose:
    """Return the best of the pose of a person and of those in squares turned by 90, 180 and 270
    degrees, by 180 in a narrow box and by 90 and 270 in a wide one; the pose itself, without
    another look, if it is steady or upright.

    Args:
        landmarker: session of ``pose_landmark_heavy``.
        picture: the photo.
        box: (4,) x0 y0 x1 y1 px of the person.
        pose: found without turning.
        fit: how well a pose fits the person, in [0, 1].
    """
    if is_stable_pose(pose, fit(pose)) or _is_upright(pose, box):
        return pose
    turned = [
        predict_pose_if_present(
            landmarker, picture, square_around(box, quarter * np.pi / 2), _LEAST_FIRST_SCORE
        )
        for quarter in _quarters(box)
    ]
    return min(
        [pose, *(one for one in turned if one is not None and _is_clear(one, fit(one)))],
        key=lambda one: one.mirror_gap - _SCORE_WEIGHT * one.score - _FIT_WEIGHT * fit(one),
    )


def _quarters(box: FloatArray) -> tuple[int, ...]:
    """Return the turns, in quarters, that a person in a box (4,) can have."""
    width, height = box[2:] - box[:2]
    if width <= _UPRIGHT_WIDTH * height:
        return (2,)
    return (1, 3) if height <= _UPRIGHT_WIDTH * width else (1, 2, 3)


def is_stable_pose(pose: Pose, fit: float) -> bool:
    """Return whether a pose is clear, fits the person, and is the same in the mirror image."""
    return pose.score > 0.5 and pose.mirror_gap < SURE_MIRROR_GAP and fit >= SURE_FIT


def is_rotated_pose(pose: Pose, fit: float) -> bool:
    """Return whether a pose was clearly found in a square that is turned by more than 45 degrees:
    other ways to look for people expect them upright.
    """
    return bool(np.cos(pose.square.angle) < np.cos(np.radians(UPRIGHT_DEG))) and _is_clear(
        pose, fit
    )


def _is_clear(pose: Pose, fit: float) -> bool:
    return pose.mirror_gap < _LARGEST_GAP and fit > _LEAST_FIT


def _is_upright(pose: Pose, box: FloatArray) -> bool:
    """Return whether the trunk points up in a narrow box (4,), as in the mirror image."""
    x, y = pose.points[[11, 12]].mean(0) - pose.points[[23, 24]].mean(0)
    narrow = box[2] - box[0] <= _UPRIGHT_WIDTH * (box[3] - box[1])
    same = pose.mirror_gap < _UPRIGHT_GAP
    return bool(narrow and same and abs(np.degrees(np.arctan2(x, -y))) <= UPRIGHT_DEG)
