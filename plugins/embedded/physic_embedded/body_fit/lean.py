"""Measure how far a body leans towards the camera.

3D landmarks of single-person networks lean towards the camera by 10 degrees and more. The image
cannot show it, because the joints project to the same pixels. The floor can: people who stand on
straight legs have the neck above the ankles.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.body import JOINT_INDEX, joint_pair

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray


def lean_towards_camera(
    joints: FloatArray, turn: FloatArray, up: FloatArray, legs_hidden: BoolArray
) -> FloatArray:
    """Return the signed angle from the vertical to the line from ankles to neck, or from hips to
    neck of people without visible legs, in the side view of each person.

    Args:
        joints: (N, 55, 3) camera frame.
        turn: (N, 3, 3) from the axes of a camera that looks straight at the person to this
            camera's.
        up: (3,) camera frame.
        legs_hidden: (N,) people without visible legs.

    Returns:
        (N,) radians; positive leans towards the camera.
    """
    hips, ankles = (joints[:, joint_pair(name)].mean(1) for name in ("hip", "ankle"))
    foot = np.where(legs_hidden[:, None], hips, ankles)
    column = np.einsum("nij,ni->nj", turn, joints[:, JOINT_INDEX["neck"]] - foot)
    seen_up = np.einsum("nij,i->nj", turn, up)
    lean = np.arctan2(column[:, 2], -column[:, 1]) - np.arctan2(seen_up[:, 2], -seen_up[:, 1])
    return np.asarray(-((lean + np.pi) % (2 * np.pi) - np.pi))
