"""Which joints of a body the photo shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .skeleton import point_rows

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from physic_core.types import Intrinsics, Keypoints

__all__ = ["observed_joints"]

_SEEN = 0.5


def observed_joints(keypoints: Keypoints, intrinsics: Intrinsics) -> NDArray[np.bool_]:
    """(N, 55) bool: joints whose keypoint is seen inside the picture.

    Joints without a keypoint go with their neighbours: hands with the wrist, the foot's joint with heel or toes, the
    neck and head with any point of the face, the pelvis with a hip, the chest with a shoulder, the lower spine with
    both.
    """
    import numpy as np

    from physic_core.body import JOINT_INDEX, JOINT_NAMES

    row = point_rows(keypoints.skeleton)
    inside = (keypoints.points > -0.5) & (keypoints.points < np.array([intrinsics.width, intrinsics.height]) - 0.5)
    seen = inside.all(-1) & (keypoints.confidence >= _SEEN)

    def any_of(*ends: str) -> NDArray[np.bool_]:
        rows = [r for name, r in row.items() if name.endswith(ends)]
        return np.asarray(seen[:, rows].any(1)) if rows else np.zeros(len(seen), bool)

    observed = np.zeros((len(seen), len(JOINT_NAMES)), bool)
    for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle"):
        for side in ("left", "right"):
            observed[:, JOINT_INDEX[f"{side}_{joint}"]] = seen[:, row[f"{side}_{joint}"]]
    for side in ("left", "right"):
        feet = any_of(f"{side}_heel", f"{side}_foot_tip", f"{side}_big_toe", f"{side}_small_toe")
        ankle = observed[:, JOINT_INDEX[f"{side}_ankle"]]
        has_feet = f"{side}_heel" in row
        observed[:, JOINT_INDEX[f"{side}_foot"]] = feet if has_feet else ankle
        observed[:, JOINT_INDEX[f"{side}_collar"]] = observed[:, JOINT_INDEX[f"{side}_shoulder"]]
        fingers = [i for name, i in JOINT_INDEX.items() if name.startswith(side) and name[-1].isdigit()]
        for finger in fingers:
            observed[:, finger] = observed[:, JOINT_INDEX[f"{side}_wrist"]]
    face = any_of("nose", "_eye_surface", "_ear_surface")
    shoulders, hips = any_of("shoulder"), any_of("hip")
    for name, value in (
        *((name, face) for name in ("neck", "head", "jaw", "left_eye", "right_eye")),
        ("pelvis", hips),
        ("spine1", hips & shoulders),
        ("spine2", hips & shoulders),
        ("spine3", shoulders),
    ):
        observed[:, JOINT_INDEX[name]] = value
    return observed
