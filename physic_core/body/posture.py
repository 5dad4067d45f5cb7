"""Posture from joints: who stands straight, and how far a body leans."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.body.joints import JOINT_INDEX, joint_pair

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Plane

    Array = NDArray[np.floating[Any]]

__all__ = ["lean_deg", "stands_straight"]

_HIPS, _KNEES, _ANKLES = joint_pair("hip"), joint_pair("knee"), joint_pair("ankle")
_NECK = JOINT_INDEX["neck"]
_STRAIGHT_KNEE_DEG = 140.0
_STRAIGHT_HIP_DEG = 35.0


def stands_straight(joints: Array) -> bool:
    """Whether both legs are straight and the trunk is in line with them, so that a lean of the body is an error.

    Both knees are over 140 degrees, and the trunk is within 35 degrees of the line of the legs. Stricter than
    :func:`physic_core.engine.joint.limbs.is_standing`, for which one straight leg is enough: a person
    who steps up is held to the floor, but may lean.

    Args:
        joints: (55, 3) metres, any frame.
    """
    hips, knees, ankles = (np.asarray(joints, np.float64)[pair] for pair in (_HIPS, _KNEES, _ANKLES))
    bends = [180.0 - _angle_deg(k - h, a - k) for h, k, a in zip(hips, knees, ankles, strict=True)]
    trunk = np.asarray(joints[_NECK], np.float64) - hips.mean(0)
    return min(bends) > _STRAIGHT_KNEE_DEG and _angle_deg(trunk, hips.mean(0) - ankles.mean(0)) < _STRAIGHT_HIP_DEG


def lean_deg(joints: Array, floor: Plane) -> tuple[float, float]:
    """Tilt of the line from between the ankles to the neck against the floor's normal, and its part to the camera.

    Returns:
        the tilt in degrees, and its signed component in the upright plane through camera and ankles: positive where
        the neck is nearer to the camera than the ankles are.
    """
    normal = np.asarray(floor.normal, np.float64)
    foot = np.asarray(joints, np.float64)[_ANKLES].mean(0)
    body = np.asarray(joints[_NECK], np.float64) - foot
    towards = -foot - (-foot @ normal) * normal  # the camera is the origin
    length = float(np.linalg.norm(towards))
    part = math.nan if length < 1e-9 else math.degrees(math.atan2(body @ towards / length, body @ normal))
    return _angle_deg(body, normal), part


def _angle_deg(first: Array, second: Array) -> float:
    cross = float(np.linalg.norm(np.cross(first, second)))
    return math.degrees(math.atan2(cross, float(first @ second)))
