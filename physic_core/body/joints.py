"""Names, parents and indices of the 55 SMPL-X joints, which every body model here uses."""

from __future__ import annotations

from physic_core.types.bodies import FINGERS
from physic_core.types.bodies import JOINT_INDEX as JOINT_INDEX
from physic_core.types.bodies import JOINT_NAMES as JOINT_NAMES
from physic_core.types.skeletons import SIDES

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
    tuple(tuple(JOINT_INDEX[f"{side}_{finger}{k}"] for k in (1, 2, 3)) for finger in FINGERS)
    for side in SIDES
)
"""(2, 5, 3) indices of the finger joints: side, finger, joint from the base."""

PARENTS: tuple[int, ...] = (
    *(-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15),
    *(
        wrist if k == 0 else first + 3 * finger + k - 1
        for first, wrist in ((25, 20), (40, 21))
        for finger in range(len(FINGERS))
        for k in range(3)
    ),
)
"""Index of each joint's parent; -1 for the pelvis."""


def joint_pair(name: str) -> list[int]:
    """Return the indices of the left and the right joint of a name: ``joint_pair("ankle") == [7,
    8]``.
    """
    return [JOINT_INDEX[f"{side}_{name}"] for side in SIDES]


MAX_FLEXION = 2.7
"""Largest bend of knees and elbows, radians."""

_LIMBS = ("upper_arm", "lower_arm", "hand", "upper_leg", "lower_leg", "foot")

PART_NAMES: tuple[str, ...] = (
    "torso",
    "head",
    *(f"{side}_{limb}" for limb in _LIMBS for side in SIDES),
)
"""Names of the body parts: torso with pelvis, head with neck, and six parts on each side."""
