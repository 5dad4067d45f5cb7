"""People who stand upright in the picture, as far as 2D keypoints tell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_embedded.body_fit.limb_keypoints import limb_keypoints, point_rows
from physic_embedded.single_view.disparity_offset import Standing

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Keypoints

__all__ = ["standing_people"]

_SEEN = 0.5  # confidence of a joint that counts as seen
_MAX_TILT_DEG = 15.0
_MAX_KNEE_DEG = 25.0


def standing_people(keypoints: Keypoints | None, height: int, width: int) -> tuple[Standing, ...]:
    """Whoever is seen from nose to ankles, with a straight trunk and one straight leg, both upright in the picture.

    Args:
        keypoints: of the photo, or None.
        height: of the photo, px.
        width: of the photo, px.
    """

    if keypoints is None or not len(keypoints.points):
        return ()
    keypoints = limb_keypoints(keypoints)
    row = point_rows(keypoints.joint_set)
    needed = [row[n] for n in ("nose", "left_shoulder", "right_shoulder", "left_hip", "right_hip")]
    needed += [row[f"{side}_{joint}"] for side in ("left", "right") for joint in ("knee", "ankle")]
    people = []
    for points, confidence in zip(keypoints.points, keypoints.confidence, strict=True):
        seen = points[needed]
        inside = (seen >= 0).all() and (seen < [width, height]).all()
        if not inside or confidence[needed].min() < _SEEN:
            continue
        at = {name: points[row[name]] for name in row}
        shoulders = (at["left_shoulder"] + at["right_shoulder"]) / 2
        ankles = (at["left_ankle"] + at["right_ankle"]) / 2
        bends = [
            _angle(at[f"{s}_knee"] - at[f"{s}_hip"], at[f"{s}_ankle"] - at[f"{s}_knee"]) for s in ("left", "right")
        ]
        lowest = max(at["left_ankle"][1], at["right_ankle"][1])
        upright = _angle(ankles - shoulders, np.array([0.0, 1.0])) < _MAX_TILT_DEG
        if upright and min(bends) < _MAX_KNEE_DEG and at["nose"][1] < lowest:
            people.append(Standing(float(at["nose"][1]), float(lowest)))
    return tuple(people)


def _angle(a: NDArray[np.floating], b: NDArray[np.floating]) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b / (np.linalg.norm(a) * np.linalg.norm(b) + 1e-9), -1, 1))))
