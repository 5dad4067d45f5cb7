"""Skeleton of the LAFAN1 data set, which retargeters to robots read: names, axes and centimetres.

A retargeter turns the axes of each joint to those of a part of the robot, so the names alone do not
suffice. The axes were read off a frame of the data set. The x axis runs along the bone. In a T-pose
the z axis of the trunk points to the person's left, that of the legs to the right, that of the left
arm up, and that of the right arm down.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import JOINT_NAMES
from physic_export.skeleton import bone_names

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_visual.rig import Rig

    Array = NDArray[np.float64]

NUM_JOINTS = 22
"""Pelvis and the 21 joints of the body; the data set has no fingers and no face."""

_CM_PER_M = 100.0
_LEFT = np.array([1.0, 0.0, 0.0])
_UP = np.array([0.0, 1.0, 0.0])
_FORWARD = np.array([0.0, 0.0, 1.0])
_LEG = ("hip", "knee", "ankle", "foot")
_BRANCHING = ("pelvis", "spine3")


def as_lafan(rig: Rig) -> Rig:
    """Return the joints of the LAFAN1 data set in the pose of a rig, lengths in centimetres.

    The skin of the returned rig is that of the given one, and not bound to its joints.

    Args:
        rig: 55 joints of SMPL-X in metres, y up.
    """
    offsets = rig.offsets[:NUM_JOINTS]
    axes = np.stack([_axes(joint, rig) for joint in range(NUM_JOINTS)])
    above = np.stack([np.eye(3), *(axes[parent] for parent in rig.parents[1:NUM_JOINTS])])
    names = tuple(name.replace("ToeBase", "Toe") for name in bone_names("mixamo"))
    return replace(
        rig,
        names=names[:NUM_JOINTS],
        parents=rig.parents[:NUM_JOINTS],
        rotations=above.swapaxes(1, 2) @ rig.rotations[:NUM_JOINTS] @ axes,
        offsets=_CM_PER_M * np.einsum("jba,jb->ja", above, offsets),
    )


def _axes(joint: int, rig: Rig) -> Array:
    """Return the axes (3, 3) of a joint in a T-pose that faces z, as columns."""
    name = JOINT_NAMES[joint]
    side, _, limb = name.rpartition("_")
    if not side:
        along = _UP
        third = _LEFT
    elif limb in _LEG:
        along = _FORWARD if limb == "foot" else -_UP
        third = -_LEFT
    else:
        along = _LEFT if side == "left" else -_LEFT
        third = _UP if side == "left" else -_UP
    children = [child for child in range(NUM_JOINTS) if rig.parents[child] == joint]
    if children and name not in _BRANCHING:
        along = rig.offsets[children[0]] / np.linalg.norm(rig.offsets[children[0]])
    second = np.cross(third, along)
    second = second / np.linalg.norm(second)
    return np.stack([along, second, np.cross(along, second)], 1)
