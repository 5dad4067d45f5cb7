"""Systematic error of BlazePose's world landmarks.

They carry an offset that is not the same on the left and on the right. It was measured as the mean residual of the
embedded body fitted to 31 people in 16 photos; halves of the photos agree on it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Skeleton

    FloatArray = NDArray[np.floating]

__all__ = ["world_landmark_offset"]

# Centimetres right, down and away from the camera that looks at the person: body minus landmark.
_WORLD_OFFSET_CM: dict[str, tuple[float, float, float]] = {
    "nose": (1.9, -0.6, 3.0),
    "left_eye_surface": (2.6, -2.4, 1.9),
    "right_eye_surface": (-0.2, -1.6, 5.3),
    "left_ear_surface": (-0.5, -4.0, 0.7),
    "right_ear_surface": (2.1, -7.9, 0.1),
    "left_mouth_corner_surface": (0.3, 0.4, 1.2),
    "right_mouth_corner_surface": (-0.3, -2.7, 3.7),
    "left_shoulder": (-0.2, -2.6, -1.9),
    "right_shoulder": (-0.8, 2.3, -6.1),
    "left_elbow": (0.0, 3.1, 2.9),
    "right_elbow": (-1.5, -0.4, 1.8),
    "left_wrist": (-0.8, 2.4, -0.2),
    "right_wrist": (1.7, 0.5, 1.6),
    "left_pinky1": (0.2, 4.6, -0.4),
    "right_pinky1": (-0.5, 3.1, 4.2),
    "left_index1": (1.5, 4.0, -0.7),
    "right_index1": (-2.5, 5.0, 3.1),
    "left_thumb2": (-2.4, 0.9, -0.6),
    "right_thumb2": (2.6, 1.1, 0.7),
    "left_hip": (-0.1, 0.1, -2.3),
    "right_hip": (0.1, -0.1, 2.3),
    "left_knee": (0.4, -2.1, -0.2),
    "right_knee": (-1.7, 2.6, 0.2),
    "left_ankle": (-2.1, -1.9, 1.7),
    "right_ankle": (0.8, -0.1, 1.3),
    "left_heel": (0.4, -0.8, 4.8),
    "right_heel": (2.1, 1.5, 7.5),
    "left_foot_tip": (-1.7, 1.8, 1.1),
    "right_foot_tip": (-0.2, 4.9, 4.0),
}


def world_landmark_offset(skeleton: Skeleton, names: list[str]) -> FloatArray:
    """Return the correction (J, 3) in metres to add to world landmarks; zeros for every skeleton but "blazepose33".

    Args:
        skeleton: of the landmarks.
        names: of its J points, in order.
    """

    table = _WORLD_OFFSET_CM if skeleton.name == "blazepose33" else {}
    return np.array([table.get(name, (0.0, 0.0, 0.0)) for name in names]).reshape(-1, 3) / 100
