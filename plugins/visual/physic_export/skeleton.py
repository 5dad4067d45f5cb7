"""Skeletons of other programs: the names of their bones, and the T-pose from which they
retarget.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import JOINT_NAMES
from physic_core.geometry import transform_points

if TYPE_CHECKING:
    from physic_core.types import Float64Array
    from physic_visual.rig import Rig

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
_UNITY = _MIXAMO | {
    "spine2": "Chest",
    "spine3": "UpperChest",
    "hip": "UpperLeg",
    "knee": "LowerLeg",
    "foot": "Toes",
    "shoulder": "UpperArm",
    "elbow": "LowerArm",
}
_THUMB_OF_VRM = {"1": "Metacarpal", "2": "Proximal", "3": "Distal"}
_SHORTEST_M = 0.01
_SEGMENTS = {"1": "Proximal", "2": "Intermediate", "3": "Distal"}


def bone_names(style: str) -> tuple[str, ...]:
    """Return the 55 names of a style, in the order of SMPL-X.

    Args:
        style: "smplx"; "mixamo", Mixamo's rig without the prefix "mixamorig:"; "unreal", Unreal
            Engine's mannequin with three spine bones; "unity", the HumanBodyBones of its humanoid
            avatar; or "vrm", the humanoid bones of VRM 1.0.
    """
    return tuple(_bone_name(joint, style) for joint in JOINT_NAMES)


def _bone_name(joint: str, style: str) -> str:
    if style == "vrm":
        return _name_of_vrm(joint)
    side, _, limb = joint.partition("_")
    finger = limb[:-1]
    number = limb[-1:]
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


def _name_of_vrm(joint: str) -> str:
    """Return the name of VRM 1.0, which is Unity's with a small letter, but for the thumb."""
    name = _bone_name(joint, "unity")
    if "thumb" in joint:
        name = name.removesuffix(_SEGMENTS[joint[-1]]) + _THUMB_OF_VRM[joint[-1]]
    return name[0].lower() + name[1:]


def named_rig(rig: Rig, style: str, up: Float64Array) -> Rig:
    """Return a rig with the names of a style, see :func:`bone_names`.

    Unreal's mannequin hangs on the bone ``root``, which moves no vertex: it is below the pelvis at
    height 0 of the frame, which is the floor.

    Args:
        rig: in the pose.
        style: of the names.
        up: (3,) unit vector, an axis of the frame.
    """
    rig = replace(rig, names=bone_names(style))
    if style != "unreal":
        return rig
    bind = np.eye(4)
    bind[:3, 3] = np.linalg.inv(rig.inverse_bind[0])[:3, 3]
    bind[1, 3] = rig.vertices[:, 1].min()
    height = (rig.offsets[0] @ up) * up
    return replace(
        rig,
        names=("root", *rig.names),
        parents=(-1, *(parent + 1 for parent in rig.parents)),
        weights=np.pad(rig.weights, ((0, 0), (1, 0))),
        inverse_bind=np.concatenate([np.linalg.inv(bind)[None], rig.inverse_bind]),
        rotations=np.concatenate([np.eye(3)[None], rig.rotations]),
        offsets=np.vstack([rig.offsets[0] - height, height, rig.offsets[1:]]),
    )


def with_ends(rig: Rig) -> Rig:
    """Return a rig of Mixamo's names with the joints that end its chains: crown, toes and finger
    tips.

    They move no vertex. Each lies where the skin of its parent ends, in the direction of the
    parent's bone; that of the head lies above it.
    """
    prefix = rig.names[0].removesuffix("Hips")
    ends = {f"{prefix}Head": f"{prefix}HeadTop_End"}
    for side in ("Left", "Right"):
        ends[f"{prefix}{side}ToeBase"] = f"{prefix}{side}Toe_End"
        for finger in ("Thumb", "Index", "Middle", "Ring", "Pinky"):
            ends[f"{prefix}{side}Hand{finger}3"] = f"{prefix}{side}Hand{finger}4"
    parents = tuple(rig.names.index(name) for name in ends)
    bind = np.linalg.inv(rig.inverse_bind)
    rest = bind[:, :3, 3]
    poses = []
    offsets = []
    for parent in parents:
        before = rest[rig.parents[parent]]
        along = np.array([0.0, 1.0, 0.0]) if parent == parents[0] else rest[parent] - before
        along = along / np.linalg.norm(along)
        length = ((rig.vertices[rig.weights[:, parent] > 0.5] - rest[parent]) @ along).max(
            initial=_SHORTEST_M
        )
        pose = bind[parent].copy()
        pose[:3, 3] += length * along
        poses.append(np.linalg.inv(pose))
        offsets.append(bind[parent, :3, :3].T @ (length * along))
    return replace(
        rig,
        names=(*rig.names, *ends.values()),
        parents=(*rig.parents, *parents),
        weights=np.pad(rig.weights, ((0, 0), (0, len(ends)))),
        inverse_bind=np.concatenate([rig.inverse_bind, poses]),
        rotations=np.concatenate([rig.rotations, np.tile(np.eye(3), (len(ends), 1, 1))]),
        offsets=np.concatenate([rig.offsets, offsets]),
    )


def t_pose(rig: Rig, up: Float64Array) -> Rig:
    """Return a rig in the T-pose: upright, at the place of the pose, with the soles at height 0. It
    faces the camera's side of the frame, as programs that move poses to other figures expect.

    Args:
        rig: in the pose.
        up: (3,) unit vector, an axis of the frame.
    """
    pelvis = int(rig.names[0] == "root")
    forward = np.cross([1.0, 0.0, 0.0], up)  # +z with y up, -y with z up
    rotations = np.tile(np.eye(3), (len(rig.names), 1, 1))
    rotations[pelvis] = np.stack([np.cross(up, forward), up, forward], 1)
    standing = replace(rig, rotations=rotations)
    offsets = rig.offsets.copy()
    offsets[pelvis] -= (standing.posed_vertices() @ up).min() * up
    return replace(standing, offsets=offsets)


def at_rest(rig: Rig, up: Float64Array) -> Rig:
    """Return a rig whose joints and mesh are in the bind pose, where :func:`t_pose` stands."""
    pelvis = int(rig.names[0] == "root")
    place = t_pose(rig, up).joint_poses()[pelvis] @ rig.inverse_bind[pelvis]
    place[:3, 3] -= (transform_points(place, rig.vertices) @ up).min() * up
    poses = place @ np.linalg.inv(rig.inverse_bind)
    above = [np.eye(4) if parent < 0 else poses[parent] for parent in rig.parents]
    local = np.linalg.inv(above) @ poses
    return replace(
        rig,
        vertices=transform_points(place, rig.vertices),
        inverse_bind=np.linalg.inv(poses),
        rotations=local[:, :3, :3],
        offsets=local[:, :3, 3],
    )
