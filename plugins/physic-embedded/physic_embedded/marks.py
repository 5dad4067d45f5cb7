"""Where BlazePose puts its landmarks, as against where the body model has the joints of the same name.

Two differences were measured by fitting the embedded body to 31 people in 16 photos with these numbers left free.
Halves of the photos agree on them, and numbers of one half lower the mean reprojection error on the other from 0.73 to
0.57 % of the body's size.

* A mark lies a little beside the joint, the same way on everybody: hips are marked low and close together, ankles high.
* World landmarks carry a constant offset that is not the same on the left and on the right.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    FloatArray = NDArray[np.floating]

__all__ = ["Marks", "marks_of"]

# Point, the point towards which its mark lies, and by which share of the way. "~" is the same joint of the other side.
_TOWARDS: tuple[tuple[str, str, float], ...] = (
    ("hip", "knee", 0.06),
    ("hip", "~hip", 0.08),
    ("ankle", "knee", 0.10),
    ("shoulder", "~shoulder", 0.055),
    ("shoulder", "hip", -0.055),
    ("heel", "ankle", 0.16),
    ("foot_tip", "heel", 0.085),
    ("foot_tip", "ankle", 0.26),
    ("ear_surface", "nose", 0.14),
    ("eye_surface", "nose", 0.05),
    ("pinky1", "wrist", 0.23),
    ("index1", "wrist", 0.21),
    ("thumb2", "wrist", 0.12),
)

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


@dataclass(frozen=True)
class Marks:
    """How marks follow from a body's points.

    Attributes:
        blend: (J, J), marks = blend @ points; each row sums to 1.
        world_offset: (J, 3) metres to add to world landmarks.
    """

    blend: FloatArray
    world_offset: FloatArray


def marks_of(skeleton: str, names: list[str]) -> Marks:
    """The marks of a joint set: those of "blazepose33", and joints themselves for every other set.

    Args:
        skeleton: joint set.
        names: of its J points, in order.
    """
    import numpy as np

    blend, offset = np.eye(len(names)), np.zeros((len(names), 3))
    if skeleton != "blazepose33":
        return Marks(blend, offset)
    row = {name: i for i, name in enumerate(names)}
    for side, other in (("left", "right"), ("right", "left")):
        for point, towards, share in _TOWARDS:
            end = towards if towards in row else f"{other}_{towards[1:]}" if towards[0] == "~" else f"{side}_{towards}"
            start = row[f"{side}_{point}"]
            blend[start, start] -= share
            blend[start, row[end]] += share
    for name, shift in _WORLD_OFFSET_CM.items():
        if name in row:
            offset[row[name]] = np.array(shift) / 100
    return Marks(blend, offset)
