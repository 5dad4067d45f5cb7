"""Names, parents and indices of the 55 SMPL-X joints, which every body model here uses."""

from __future__ import annotations

from physic_core.types.skeletons import SIDES

_FINGERS = ("index", "middle", "pinky", "ring", "thumb")

JOINT_NAMES: tuple[str, ...] = (
    "pelvis",
    "left_hip",
    "right_hip",
    "spine1",
    "left_knee",
    "right_knee",
    "spine2",
    "left_ankle",
    "right_ankle",
    "spine3",
    "left_foot",
    "right_foot",
    "neck",
    "left_collar",
    "right_collar",
    "head",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "jaw",
    "left_eye",
    "right_eye",
    *(f"{side}_{finger}{k}" for side in SIDES for finger in _FINGERS for k in (1, 2, 3)),
)
"""0-21 body, 22 jaw, 23-24 eyes, 25-39 left hand, 40-54 right hand (index, middle, pinky, ring,
thumb; base first).
"""

JOINT_INDEX: dict[str, int] = {name: i for i, name in enumerate(JOINT_NAMES)}


def joint_pair(name: str) -> list[int]:
    """Return the indices of the left and the right joint of a name: ``joint_pair("ankle") == [7,
    8]``.
    """
    return [JOINT_INDEX[f"{side}_{name}"] for side in SIDES]


NUM_JOINTS = len(JOINT_NAMES)

ROTATION_FIELDS: tuple[tuple[str, int], ...] = (
    ("global_orient", 1),
    ("body_pose", 21),
    ("jaw_pose", 1),
    ("leye_pose", 1),
    ("reye_pose", 1),
    ("left_hand_pose", 15),
    ("right_hand_pose", 15),
)
"""Rotations of BodyParameters, in the order of the joints, with the number of joints of each."""

FINGER_JOINTS: tuple[tuple[tuple[int, ...], ...], ...] = tuple(
    tuple(tuple(JOINT_INDEX[f"{side}_{finger}{k}"] for k in (1, 2, 3)) for finger in _FINGERS)
    for side in SIDES
)
"""(2, 5, 3) indices of the finger joints: side, finger, joint from the base."""

PARENTS: tuple[int, ...] = (
    *(-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15),
    *(
        wrist if k == 0 else first + 3 * finger + k - 1
        for first, wrist in ((25, 20), (40, 21))
        for finger in range(len(_FINGERS))
        for k in range(3)
    ),
)
"""Index of each joint's parent; -1 for the pelvis."""

_LIMBS = ("upper_arm", "lower_arm", "hand", "upper_leg", "lower_leg", "foot")

PART_NAMES: tuple[str, ...] = (
    "torso",
    "head",
    *(f"{side}_{limb}" for limb in _LIMBS for side in SIDES),
)
"""Names of the body parts: torso with pelvis, head with neck, and six parts on each side."""
