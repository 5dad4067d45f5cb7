"""What belongs together: part, keypoints and joints of one limb, and what an unseen joint takes along."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.joint.distances import hinge_angles
from physic_core.geometry.visibility import inside_mask
from physic_core.types.skeletons import Skeleton, is_finger

__all__ = [
    "confirmed_joints",
    "keypoints_of_observed_limbs",
    "limb_parts",
    "observed_parts",
    "placing_keypoints",
    "stands",
]

_END_JOINT = {
    "upper_leg": "knee",
    "lower_leg": "ankle",
    "foot": "ankle",
    "upper_arm": "elbow",
    "lower_arm": "wrist",
    "hand": "wrist",
}
_TRUNK = ("pelvis", "left_hip", "right_hip", "spine3", "left_shoulder", "right_shoulder")

_MOST_FINGERS = 10  # points on fingers; with more a joint set has whole hands


def limb_parts(part_names: Sequence[str]) -> list[int]:
    """Indices of arms, hands, legs and feet: what can be self-occluded."""
    return [i for i, name in enumerate(part_names) if name.startswith(("left_", "right_"))]


def confirmed_joints(skeleton: Skeleton, keypoints: Tensor, confidence: Tensor, masks: Tensor, least: float) -> Tensor:
    """Joints of which a keypoint is sure and lies on the person's mask: the photo shows them, whatever else is said.

    A toe shows its ankle and a finger its wrist.

    Args:
        skeleton: of the J keypoints.
        keypoints: (B, J, 2) px.
        confidence: (B, J).
        masks: (B, H, W) bool.
        least: confidence; 1 confirms nothing.

    Returns:
        (B, 55) bool.
    """
    confirmed = torch.zeros(len(keypoints), len(JOINT_INDEX), dtype=torch.bool, device=keypoints.device)
    if least >= 1:
        return confirmed
    finite = torch.isfinite(keypoints).all(-1) & torch.isfinite(confidence)
    sure = finite & (confidence >= least) & inside_mask(torch.nan_to_num(keypoints), masks)
    for j, name in enumerate(skeleton.names):
        joint = _joint_of(name)
        if joint is not None:
            confirmed[:, JOINT_INDEX[joint]] |= sure[:, j]
    return confirmed


def observed_parts(part_names: Sequence[str], observed: Tensor) -> Tensor:
    """Parts that the photo shows: a limb's segment when the joint at its end is seen.

    Args:
        part_names: P names, "left_upper_leg" and the like; others are trunk or head.
        observed: (B, 55) bool.

    Returns:
        (B, P) bool.
    """
    trunk = observed[:, [JOINT_INDEX[name] for name in _TRUNK]].any(1)
    columns = []
    for name in part_names:
        side, _, segment = name.partition("_")
        if segment in _END_JOINT:
            columns.append(observed[:, JOINT_INDEX[f"{side}_{_END_JOINT[segment]}"]])
        else:
            columns.append(observed[:, JOINT_INDEX["head"]] if name == "head" else trunk)
    return torch.stack(columns, 1)


def keypoints_of_observed_limbs(skeleton: Skeleton, observed: Tensor) -> Tensor:
    """Keypoints of limbs that the photo shows: (B, 55) bool -> (B, J) bool.

    Points of the face, and points with a name of the skeleton's own, always count as seen.
    """
    seen = torch.ones(len(observed), len(skeleton), dtype=torch.bool, device=observed.device)
    for j, name in enumerate(skeleton.names):
        joint = _joint_of(name)
        if joint is not None:
            seen[:, j] = observed[:, JOINT_INDEX[joint]]
    return seen


def placing_keypoints(skeleton: Skeleton) -> list[int]:
    """Indices of the keypoints that place a body.

    All of them, unless a joint set has whole hands: forty points of fingers, whose pose is not known yet, would then
    outvote the body.
    """
    fingers = {j for j, name in enumerate(skeleton.names) if is_finger(name)}
    return [j for j in range(len(skeleton)) if len(fingers) <= _MOST_FINGERS or j not in fingers]


def _joint_of(landmark: str) -> str | None:
    """The joint whose being seen a keypoint depends on; None for the face, whose own confidence is enough."""
    side, _, rest = landmark.partition("_")
    if rest.endswith(("toe", "heel", "foot_tip")):
        return f"{side}_ankle"
    if is_finger(rest):
        return f"{side}_wrist"
    return landmark if landmark in JOINT_INDEX and landmark != "head" else None


def stands(rotations: Tensor, joints: Tensor, observed: Tensor, up: Tensor | None = None) -> Tensor:
    """Who stands: at least one knee nearly straight, trunk in line with the legs, both ankles seen, and not lying.

    Args:
        rotations: (B, 55, 3, 3).
        joints: (B, 55, 3) metres.
        observed: (B, 55) bool.
        up: (3,) unit normal of the floor; without it who lies straight stands too.

    Returns:
        (B,) bool.
    """

    def at(name: str) -> Tensor:
        return joints[:, JOINT_INDEX[name]]

    ankles = [JOINT_INDEX["left_ankle"], JOINT_INDEX["right_ankle"]]
    trunk = torch.nn.functional.normalize(at("neck") - at("pelvis"), dim=-1)
    leg = torch.nn.functional.normalize(at("pelvis") - joints[:, ankles].mean(1), dim=-1)
    in_line = (trunk * leg).sum(-1) > 0.82  # 35 degrees
    if up is not None:
        in_line = in_line & (((trunk + leg) / 2) @ up > 0.5)  # 60 degrees, estimators err by 20
    straight = hinge_angles(rotations)[:, :2].amin(-1) < 0.7  # 40 degrees
    return in_line & straight & observed[:, ankles].all(1)
