"""Select the keypoints that the body fit uses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.errors import BackendError
from physic_core.types import MAX_FINGER_KEYPOINTS, SIDES, SKELETONS, is_finger

if TYPE_CHECKING:
    from physic_core.types import Keypoints, Skeleton

LIMBS = tuple(
    f"{side}_{joint}"
    for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    for side in SIDES
)
"""Names of the keypoints of arms and legs, which the body fit needs."""

HIP_WEIGHT = 0.5
"""Share of the weight of a hip: networks mark hips on the surface, bodies have them inside."""


def limb_keypoints(keypoints: Keypoints) -> Keypoints:
    """Select the keypoints that the body fit uses: for a whole-body skeleton, those of COCO-17 and
    the feet.

    For other skeletons, these are all keypoints that the body model has.

    Raises:
        BackendError: the skeleton is unknown, or lacks a joint of an arm or a leg.
    """
    try:
        skeleton = keypoints.joint_set
    except ValueError as error:
        raise BackendError(str(error)) from error
    if missing := [name for name in LIMBS if name not in skeleton.names]:
        raise BackendError(
            "the embedded body is fitted to shoulders, elbows, wrists, hips, knees and ankles, and "
            f"the skeleton {skeleton.name!r} has no {', '.join(missing)}: choose a keypoint "
            "detector that detects them"
        )
    columns = list(skeleton.fitted)
    if sum(is_finger(skeleton.names[i]) for i in columns) > MAX_FINGER_KEYPOINTS:
        columns = [i for i in columns if skeleton.names[i] in SKELETONS["coco23"].names]
    if len(columns) == len(skeleton):
        return keypoints
    return keypoints.take(columns)


def keypoint_indices(skeleton: Skeleton) -> dict[str, int]:
    """Return a dict from keypoint name to keypoint index for a skeleton."""
    return {name: row for row, name in enumerate(skeleton.names)}


def sided_indices(skeleton: Skeleton, *joints: str) -> list[int]:
    """Return the indices of the left and the right keypoint of each joint, such as "knee"."""
    return [skeleton.names.index(f"{side}_{joint}") for joint in joints for side in SIDES]
