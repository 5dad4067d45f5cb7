"""Limbs: visible joints, body parts and keypoints of arms and legs."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX, joint_pair
from physic_core.types.skeletons import MAX_FINGER_KEYPOINTS, Skeleton, is_finger

_END_JOINT = {
    "upper_leg": "knee",
    "lower_leg": "ankle",
    "foot": "ankle",
    "upper_arm": "elbow",
    "lower_arm": "wrist",
    "hand": "wrist",
}
_TRUNK = [
    *(JOINT_INDEX[name] for name in ("pelvis", "spine3")),
    *joint_pair("hip"),
    *joint_pair("shoulder"),
]

LOWEST_SHARE = 0.01
"""Share of the skin whose place is less sure than that of all."""
_LAYER_M = 0.05


def limb_part_indices(part_names: Sequence[str]) -> list[int]:
    """Return the indices of the parts of arms, hands, legs and feet."""
    return [i for i, name in enumerate(part_names) if name.startswith(("left_", "right_"))]


def observed_parts(part_names: Sequence[str], observed: Tensor) -> Tensor:
    """Return the visible body parts (B, P) bool.

    A limb segment is visible if the joint at its end is visible.

    Args:
        part_names: P names, like "left_upper_leg"; others are trunk or head.
        observed: (B, 55) bool, visible joints.
    """
    trunk = observed[:, _TRUNK].any(1)
    columns = []
    for name in part_names:
        side, _, segment = name.partition("_")
        if segment in _END_JOINT:
            columns.append(observed[:, JOINT_INDEX[f"{side}_{_END_JOINT[segment]}"]])
        else:
            columns.append(observed[:, JOINT_INDEX["head"]] if name == "head" else trunk)
    return torch.stack(columns, 1)


def lowest_layer(height: Tensor, skin: Tensor) -> Tensor:
    """Return the lowest layer (V,) bool of the skin (V,) bool of one body, without the lowest 1 %,
    by the heights (V,) of its vertices, metres: what rests if any part may.
    """
    lowest = height[skin].kthvalue(max(1, round(LOWEST_SHARE * int(skin.sum())))).values
    return skin & (height >= lowest) & (height < lowest + _LAYER_M)


def keypoints_of_observed_limbs(skeleton: Skeleton, observed: Tensor) -> Tensor:
    """Return the keypoints (B, J) bool on visible limbs, given the visible joints (B, 55) bool.

    Keypoints of the face, and keypoints with names specific to the skeleton, always count as
    visible.
    """
    observed_keypoints = torch.ones(len(observed), len(skeleton), dtype=torch.bool)
    for j, name in enumerate(skeleton.names):
        joint = _joint_of(name)
        if joint is not None:
            observed_keypoints[:, j] = observed[:, JOINT_INDEX[joint]]
    return observed_keypoints


def placement_keypoints(skeleton: Skeleton) -> list[int]:
    """Return the indices of the keypoints that determine the position of a body.

    If a joint set has keypoints of all finger joints, fingers are skipped: forty keypoints, for
    which the hand pose is not known yet, would outweigh the body.
    """
    fingers = {j for j, name in enumerate(skeleton.names) if is_finger(name)}
    return [
        j for j in range(len(skeleton)) if len(fingers) <= MAX_FINGER_KEYPOINTS or j not in fingers
    ]


def _joint_of(landmark: str) -> str | None:
    """Return the joint that decides whether a keypoint is visible; None for keypoints of the face
    and unknown names.
    """
    side, _, rest = landmark.partition("_")
    if rest.endswith(("toe", "heel", "foot_tip")):
        return f"{side}_ankle"
    if is_finger(rest):
        return f"{side}_wrist"
    return landmark if landmark in JOINT_INDEX and landmark != "head" else None
