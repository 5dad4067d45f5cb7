"""Skeletons of other programs: the names of their bones, and the T-pose from which they retarget."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.joints import JOINT_NAMES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.visual.rig import Rig

BONE_NAMES = ("smplx", "mixamo", "unreal", "unity")
"""SMPL-X; Mixamo's rig without the prefix "mixamorig:"; Unreal Engine's mannequin with three spine bones; the
HumanBodyBones of Unity's humanoid avatar."""

_MIXAMO = {
    "pelvis": "Hips",
    "spine1": "Spine",
    "spine2": "Spine1",
    "spine3": "Spine2",
    "neck": "Neck",
    "head": "Head",
    "jaw": "Jaw",
    "hip": "UpLeg",
    "knee": "Leg",
    "ankle": "Foot",
    "foot": "ToeBase",
    "collar": "Shoulder",
    "shoulder": "Arm",
    "elbow": "ForeArm",
    "wrist": "Hand",
    "eye": "Eye",
}
_UNREAL = {
    "spine1": "spine_01",
    "spine2": "spine_02",
    "spine3": "spine_03",
    "neck": "neck_01",
    "hip": "thigh",
    "knee": "calf",
    "ankle": "foot",
    "foot": "ball",
    "collar": "clavicle",
    "shoulder": "upperarm",
    "elbow": "lowerarm",
    "wrist": "hand",
}
_UNITY = {
    "pelvis": "Hips",
    "spine1": "Spine",
    "spine2": "Chest",
    "spine3": "UpperChest",
    "neck": "Neck",
    "head": "Head",
    "jaw": "Jaw",
    "hip": "UpperLeg",
    "knee": "LowerLeg",
    "ankle": "Foot",
    "foot": "Toes",
    "collar": "Shoulder",
    "shoulder": "UpperArm",
    "elbow": "LowerArm",
    "wrist": "Hand",
    "eye": "Eye",
}
_SEGMENTS = {"1": "Proximal", "2": "Intermediate", "3": "Distal"}


def bone_names(style: str) -> tuple[str, ...]:
    """Return the 55 names of a style of BONE_NAMES, in the order of SMPL-X."""
    return tuple(_name(joint, style) for joint in JOINT_NAMES)


def _name(joint: str, style: str) -> str:
    side, _, limb = joint.partition("_")
    finger, number = limb[:-1], limb[-1:]
    if style == "smplx":
        return joint
    if style == "unreal":
        if not limb:
            return _UNREAL.get(joint, joint)
        part = f"{finger}_0{number}" if number.isdigit() else _UNREAL.get(limb, limb)
        return f"{part}_{side[0]}"
    table = _MIXAMO if style == "mixamo" else _UNITY
    if not limb:
        return table[joint]
    if not number.isdigit():
        return side.capitalize() + table[limb]
    if style == "mixamo":
        return f"{side.capitalize()}Hand{finger.capitalize()}{number}"
    return side.capitalize() + finger.replace("pinky", "little").capitalize() + _SEGMENTS[number]


def t_pose(rig: Rig, up: NDArray[np.float64]) -> Rig:
    """Return a rig in the T-pose: upright, at the place of the pose, facing as it does, with the soles at height 0.

    Args:
        rig: in the pose.
        up: (3,) unit vector, an axis of the frame.
    """
    forward = rig.rotations[0] @ [0.0, 0.0, 1.0]
    forward = forward - (forward @ up) * up
    if np.linalg.norm(forward) < 1e-6:  # a body that lies: its head points where it would face
        forward = rig.rotations[0] @ [0.0, 1.0, 0.0]
        forward = forward - (forward @ up) * up
    forward = forward / np.linalg.norm(forward)
    rotations = np.tile(np.eye(3), (len(rig.names), 1, 1))
    rotations[0] = np.stack([np.cross(up, forward), up, forward], 1)
    standing = replace(rig, rotations=rotations)
    offsets = rig.offsets.copy()
    offsets[0] = offsets[0] - (skinned(standing) @ up).min() * up
    return replace(standing, offsets=offsets)


def skinned(rig: Rig) -> NDArray[np.float64]:
    """Return the vertices (V, 3) of a rig in its pose."""
    bones = (rig.world() @ rig.inverse_bind)[:, :3]
    moved = rig.weights @ bones.reshape(len(bones), 12)
    points: NDArray[np.float64] = np.einsum(
        "vij,vj->vi", moved.reshape(-1, 3, 4), np.pad(rig.vertices, ((0, 0), (0, 1)), constant_values=1.0)
    )
    return points
