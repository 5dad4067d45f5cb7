"""Posture of a body from its joints: the legs that it stands on, and its lean."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from physic_core.body.joints import JOINT_INDEX, joint_pair

if TYPE_CHECKING:
    from physic_core.types import BoolArray, Float64Array, FloatArray, Plane

_HIPS = joint_pair("hip")
_KNEES = joint_pair("knee")
_ANKLES = joint_pair("ankle")
_NECK = JOINT_INDEX["neck"]
_PELVIS = JOINT_INDEX["pelvis"]

STANDING_DEG = 40.0
"""Largest bend of a body that stands, degrees.

Body estimators bend the knees of standing people by up to 30.
"""

LYING_DEG = 30.0
"""Largest angle between the trunk of a person who lies and the horizontal."""
_UPSIDE_DOWN_DEG = 135.0  # least angle of a trunk from up in the picture
_SIDEWAYS_DEG = 30.0  # largest angle of a trunk from the picture's horizontal


def standing_legs(joints: FloatArray, up: FloatArray | None = None) -> BoolArray:
    """Return the left and the right leg on which each body stands, (..., 2) bool; see
    :func:`legs_in_line`.

    Args:
        joints: (..., 55, 3) metres, any frame.
        up: (3,) in that frame; None if it is unknown, and bodies that lie straight count as
            standing, too.
    """
    exact = np.asarray(joints, np.float64)
    parts = (exact[..., rows, :] for rows in (_HIPS, _KNEES, _ANKLES))
    return legs_in_line(*parts, neck=exact[..., _NECK, :], up=up)


def legs_in_line(
    hips: FloatArray,
    knees: FloatArray,
    ankles: FloatArray,
    *,
    neck: FloatArray | None = None,
    up: FloatArray | None = None,
    max_deg: float = STANDING_DEG,
) -> BoolArray:
    """Return which legs are straight, in line with the trunk, and upright: (..., 2) bool, left and
    right.

    No angle exceeds ``max_deg``: that of thigh and shank, of leg and trunk, and of ``up`` and the
    line from the ankle to the neck. Works in the picture as well as in space. False where a point
    is NaN.

    Args:
        hips: (..., 2, D) left and right.
        knees: (..., 2, D).
        ankles: (..., 2, D).
        neck: (..., D); None if the trunk does not matter, and ``up`` is compared with the leg.
        up: (D,); None if the direction does not matter.
        max_deg: largest angle, degrees.
    """
    leg = hips - ankles
    angles = [angle_deg(hips - knees, knees - ankles)]
    if neck is not None:
        angles.append(angle_deg(leg, (neck - hips.mean(-2))[..., None, :]))
    if up is not None:
        angles.append(angle_deg(leg if neck is None else neck[..., None, :] - ankles, up))
    return np.asarray(np.maximum.reduce(angles) < max_deg)


def lean_deg(joints: FloatArray, floor: Plane, of: Literal["body", "trunk"] = "body") -> float:
    """Return how far a body leans towards the camera, degrees; negative if it leans away.

    It is the angle between the body and the vertical plane across the direction to the camera, so
    that a body that lies across the picture does not lean. The body is the line from the midpoint
    of the ankles to the neck, the trunk that from the midpoint of the hips.

    Args:
        joints: (55, 3) metres, camera frame.
        floor: under the body.
        of: what leans.
    """
    normal = np.asarray(floor.normal, np.float64)
    foot = np.asarray(joints, np.float64)[_ANKLES if of == "body" else _HIPS].mean(0)
    body = np.asarray(joints[_NECK], np.float64) - foot
    towards = -foot - body / 2  # the camera is the origin
    level = towards - (towards @ normal) * normal
    return 90.0 - float(angle_deg(body, level))


def trunk_tilt_deg(joints: FloatArray, up: FloatArray) -> Float64Array:
    """Return the angle between each trunk, from pelvis to neck of (..., 55, 3), and an up direction
    (3,), degrees.
    """
    exact = np.asarray(joints, np.float64)
    return angle_deg(exact[..., _NECK, :] - exact[..., _PELVIS, :], np.asarray(up, np.float64))


def photo_seems_turned(joints: FloatArray, floor: Plane | None) -> bool:
    """Return whether a photo seems to be turned, by its people.

    The trunks of all people point down in the picture, or all point to the same side, and people
    are straight. No floor beneath them is known.

    Args:
        joints: (P, 55, 3) metres, camera frame, NaN for people without a body.
        floor: of the scene, if one was found.
    """
    people = np.asarray(joints, np.float64)[np.isfinite(joints[:, [_PELVIS, _NECK]]).all((1, 2))]
    pixels = people[..., :2] / people[..., 2:]
    x, y = (pixels[:, _NECK] - pixels[:, _PELVIS]).T
    turned = np.degrees(np.arctan2(x, -y))  # from up in the picture, clockwise
    if not len(people):
        return False
    tilt = 0.0 if floor is None else trunk_tilt_deg(people, floor.normal)
    if (np.abs(turned) > _UPSIDE_DOWN_DEG).all():
        return not (np.abs(tilt - 90.0) < LYING_DEG).all()
    sideways = any((np.abs(side * turned - 90.0) < _SIDEWAYS_DEG).all() for side in (-1, 1))
    lying = np.any(tilt > STANDING_DEG)
    return bool(sideways and not lying and standing_legs(people).any(1).all())


def angle_deg(first: FloatArray, second: FloatArray) -> Float64Array:
    """Return the angles between vectors (..., D), degrees; 90 for a zero vector."""
    one, two = (
        v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12) for v in (first, second)
    )
    half = np.arctan2(np.linalg.norm(one - two, axis=-1), np.linalg.norm(one + two, axis=-1))
    return np.asarray(2 * np.degrees(half))
