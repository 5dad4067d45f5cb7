"""Posture of a body from its joints: straightness and lean."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from physic_core.body.joints import JOINT_INDEX, joint_pair

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Plane

    Array = NDArray[np.floating[Any]]

_HIPS, _KNEES, _ANKLES = joint_pair("hip"), joint_pair("knee"), joint_pair("ankle")
_NECK, _PELVIS = JOINT_INDEX["neck"], JOINT_INDEX["pelvis"]
_STRAIGHT_KNEE_DEG = 140.0
_STRAIGHT_HIP_DEG = 35.0


def is_body_straight(joints: Array) -> bool:
    """Return whether both legs are straight and in line with the trunk.

    Straight bodies should not lean. Both knee angles are over 140 degrees, and the trunk is within 35 degrees of the
    line of the legs. Stricter than :func:`physic_core.engine.limbs.is_standing`, which needs one straight leg.

    Args:
        joints: (55, 3) metres, any frame.
    """
    exact = np.asarray(joints, np.float64)
    return stands_on_straight_legs(exact, exact[_NECK] - exact[_HIPS].mean(0))


def stands_on_straight_legs(joints: Array, up: Array) -> bool:
    """Return whether both legs are straight and upright, however the trunk is bent.

    Args:
        joints: (55, 3) metres, any frame.
        up: (3,) in that frame.
    """
    hips, knees, ankles = (np.asarray(joints, np.float64)[pair] for pair in (_HIPS, _KNEES, _ANKLES))
    bends = [180.0 - _angle_deg(k - h, a - k) for h, k, a in zip(hips, knees, ankles, strict=True)]
    return min(bends) > _STRAIGHT_KNEE_DEG and _angle_deg(hips.mean(0) - ankles.mean(0), up) < _STRAIGHT_HIP_DEG


def lean_deg(joints: Array, floor: Plane, of: Literal["body", "trunk"] = "body") -> tuple[float, float]:
    """Return the angle between body and floor normal, and its signed component towards the camera, in degrees.

    The body is the line from the midpoint of the ankles to the neck, the trunk that from the midpoint of the hips. The
    signed part is measured in the vertical plane through camera and ankles or hips: positive if the neck is nearer.
    """
    normal = np.asarray(floor.normal, np.float64)
    foot = np.asarray(joints, np.float64)[_ANKLES if of == "body" else _HIPS].mean(0)
    body = np.asarray(joints[_NECK], np.float64) - foot
    towards = -foot - (-foot @ normal) * normal  # the camera is the origin
    length = float(np.linalg.norm(towards))
    part = math.nan if length < 1e-9 else math.degrees(math.atan2(body @ towards / length, body @ normal))
    return _angle_deg(body, normal), part


def trunk_tilt_deg(joints: Array, up: Array) -> float:
    """Return the angle between the trunk, from pelvis to neck, and an up direction (3,), in degrees."""
    trunk = np.asarray(joints[_NECK], np.float64) - np.asarray(joints[_PELVIS], np.float64)
    return _angle_deg(trunk, np.asarray(up, np.float64))


def _angle_deg(first: Array, second: Array) -> float:
    """Return the angle between two vectors, degrees."""
    cross = float(np.linalg.norm(np.cross(first, second)))
    return math.degrees(math.atan2(cross, float(first @ second)))
