"""Prior of body poses: a Gaussian for each joint about a relaxed stance, and joints that bend in
one direction.

Rotation vectors are those of SMPL-X: zero is the T-pose, y up, facing +z, left on +x. A knee bends
about +x, the left elbow about -y and the right one about +y.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import JOINT_INDEX, JOINT_NAMES
from physic_core.types import SIDES

if TYPE_CHECKING:
    from physic_core.types import FloatArray


# Standard deviations in radians about x, y, z of each joint's own T-pose axes; left and right
# alike.
_SIGMA: dict[str, tuple[float, float, float]] = {
    "hip": (1.2, 0.5, 0.5),
    "knee": (2.0, 0.12, 0.12),
    "ankle": (0.35, 0.35, 0.35),
    "foot": (0.1, 0.1, 0.1),
    "spine1": (0.25, 0.2, 0.15),
    "spine2": (0.25, 0.2, 0.15),
    "spine3": (0.25, 0.2, 0.15),
    "neck": (0.25, 0.25, 0.25),
    "head": (0.25, 0.25, 0.25),
    "collar": (0.15, 0.15, 0.15),
    "shoulder": (0.9, 0.9, 0.9),
    "elbow": (0.3, 2.0, 0.15),
    "wrist": (0.35, 0.35, 0.35),
}
_ARM_DOWN = 0.9
_KNEE_BENT = 0.2
_ELBOW_BENT = 0.3
_FINGER_CURL = 0.25


def _side_sign(name: str) -> float:
    """Return +1 for a left, -1 for a right and 0 for a middle joint."""
    return float(name.startswith("left_")) - float(name.startswith("right_"))


_TIGHTER: dict[str, float] = {
    "spine": 0.4,
    "neck": 0.6,
    "head": 0.6,
    "collar": 0.6,
    "knee": 0.5,
    "hip": 0.6,
}


def pose_prior(*, tight: bool = False) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation, (21, 3) radians each, of the rotation vectors of joints 1
    to 21 of a person who may stand, walk, sit or reach.

    The standard deviations are large at hips, shoulders, knees and elbows.

    Args:
        tight: for fits to 2D keypoints alone, in which a bend towards the camera or away from it
            only looks like a shorter limb: narrower where trunk and legs would fold.
    """
    body = JOINT_NAMES[1:22]
    joints = [name.removeprefix("left_").removeprefix("right_") for name in body]
    sigma = np.array([_SIGMA[name] for name in joints])
    if tight:
        sigma *= np.array([[_TIGHTER.get(name.rstrip("123"), 1.0)] for name in joints])
    mean = np.zeros((21, 3))
    for row, name in enumerate(body):
        side = _side_sign(name)
        if name.endswith("shoulder"):
            mean[row, 2] = -side * _ARM_DOWN
        elif name.endswith("knee"):
            mean[row, 0] = _KNEE_BENT
        elif name.endswith("elbow"):
            mean[row, 1] = -side * _ELBOW_BENT
    return mean, sigma


def hinge_joints() -> tuple[tuple[int, int, float], ...]:
    """Return, for each joint that bends about one axis in one direction (knees and elbows), its
    index among joints 1 to 21, the axis, and the sign of the angle when it bends as it should.
    """
    knees = [(JOINT_INDEX[f"{side}_knee"] - 1, 0, 1.0) for side in SIDES]
    elbows = [(JOINT_INDEX[f"{side}_elbow"] - 1, 1, -_side_sign(f"{side}_")) for side in SIDES]
    return (*knees, *elbows)


def relaxed_finger_pose() -> FloatArray:
    """Return rotation vectors (33, 3) of joints 22 to 54: jaw and eyes straight, fingers slightly
    curled, thumbs flat.
    """
    curl = np.zeros((33, 3))
    for row, name in enumerate(JOINT_NAMES[22:]):
        if any(finger in name for finger in ("index", "middle", "pinky", "ring")):
            curl[row, 2] = -_side_sign(name) * _FINGER_CURL
    return curl
