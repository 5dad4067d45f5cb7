"""Joint angles by the recommendations of the International Society of Biomechanics (ISB).

Each segment has the axes x forward, y up, z right, with the body upright, legs straight, arms at
the sides and palms to the thighs. Its rotation against the segment above it is a turn about z, then
about the turned x, then about y (Grood and Suntay 1983; Wu et al. 2002, 2005).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.joints import JOINT_INDEX
from physic_core.geometry.rotations import rotmat_to_euler, rotvec_to_rotmat_numpy
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from physic_core.types import Float64Array, FloatArray

# From x left, y up, z forward to x forward, y up, z right.
_ISB = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])

_LIMBS = {
    "hip": (("hip",), ("flexion", "abduction", "rotation"), ("upper_leg",)),
    "knee": (("knee",), ("flexion", "abduction", "rotation"), ("upper_leg", "lower_leg")),
    "ankle": (("ankle",), ("dorsiflexion", "eversion", "rotation"), ("lower_leg", "foot")),
    "shoulder": (("collar", "shoulder"), ("flexion", "abduction", "rotation"), ("upper_arm",)),
    "elbow": (("elbow",), ("flexion", "abduction", "pronation"), ("upper_arm", "lower_arm")),
}
"""Joints that turn each limb, names of its turns about z, x and y, and the parts that show them."""

_TRUNK_TURNS = ("flexion", "bending", "rotation")
_TRUNK = {"trunk": ("spine1", "spine2", "spine3"), "neck": ("neck", "head")}


def joint_angles(body_pose: FloatArray) -> dict[str, float]:
    """Return the angles of a body in degrees, such as "left_knee_flexion"; NaN without a body.

    Flexion is positive, extension negative. Abduction and eversion are positive away from the body,
    rotation inwards. Trunk and neck bend forward (flexion), to the right (bending) and turn to the
    left (rotation); the trunk is the thorax against the pelvis. The elevation of a shoulder is the
    angle of the upper arm to the trunk. Flexion and rotation of a joint have no meaning near an
    abduction of 90.

    Args:
        body_pose: (63,) rotation vectors of joints 1 to 21, radians.
    """
    pose = np.asarray(body_pose, np.float64).reshape(21, 3)
    turns = _ISB @ rotvec_to_rotmat_numpy(np.nan_to_num(pose)) @ _ISB.T
    turns[np.isnan(pose).any(1)] = np.nan
    rotations = [
        (
            tuple(f"{name}_{word}" for word in _TRUNK_TURNS),
            (-1, 1, 1),
            _chain_rotation(turns, joints),
        )
        for name, joints in _TRUNK.items()
    ]
    elevations: dict[str, float] = {}
    for side, sign in zip(SIDES, (-1, 1), strict=True):
        # the arm of the T-pose, lowered to the side
        lowered = rotvec_to_rotmat_numpy(np.array([sign * np.pi / 2, 0.0, 0.0]))
        for limb, (joints, words, _) in _LIMBS.items():
            turn = _chain_rotation(turns, tuple(f"{side}_{joint}" for joint in joints))
            if limb in ("shoulder", "elbow"):
                turn = (lowered if limb == "elbow" else np.eye(3)) @ turn @ lowered.T
            names = tuple(f"{side}_{limb}_{word}" for word in words)
            rotations.append((names, (-1 if limb == "knee" else 1, -sign, sign), turn))
            if limb == "shoulder":
                elevation = np.degrees(np.arccos(np.clip(turn[1, 1], -1, 1)))
                elevations[f"{side}_shoulder_elevation"] = float(elevation)
    zxy = _joint_angles_of(np.stack([turn for *_, turn in rotations]))
    angles = {
        name: sign * angle
        for (names, signs, _), row in zip(rotations, zxy.tolist(), strict=True)
        for name, sign, angle in zip(names, signs, row, strict=True)
    }
    return {name: angle + 0.0 for name, angle in (angles | elevations).items()}  # no "-0"


def _chain_rotation(turns: Float64Array, joints: tuple[str, ...]) -> Float64Array:
    """Return the rotation of the last of some joints against the segment above the first."""
    whole = np.eye(3)
    for joint in joints:
        whole = whole @ turns[JOINT_INDEX[joint] - 1]
    return whole


def segment_axes(turn: Float64Array) -> Float64Array:
    """Return the ISB's axes (3, 3), in columns, of a segment that is turned from the T-pose."""
    axes: Float64Array = turn @ _ISB.T
    return axes


def joints_of_parts(parts: tuple[str, ...]) -> tuple[str, ...]:
    """Return the joints beside body parts, such as "left_knee" beside "left_lower_leg"."""
    return tuple(
        f"{side}_{limb}"
        for side in SIDES
        for limb, (_, _, beside) in _LIMBS.items()
        if any(f"{side}_{part}" in parts for part in beside)
    )


def _joint_angles_of(turns: Float64Array) -> Float64Array:
    """Return the angles (n, 3) about z, x and y of rotations (n, 3, 3) = Rz Rx Ry, degrees; NaN of
    rotations that are not finite.
    """
    is_finite = np.isfinite(turns).all((1, 2))
    angles = np.full((len(turns), 3), np.nan)
    if is_finite.any():
        angles[is_finite] = np.degrees(rotmat_to_euler("ZXY", turns[is_finite]))
    return angles
