"""Estimate from keypoints which body joints are visible in the photo.

Body networks also return a pose for hidden limbs, without marking it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from physic_core.body.joints import FINGER_JOINTS, JOINT_INDEX, NUM_JOINTS, joint_pair
from physic_core.types.skeletons import SIDES, is_finger

if TYPE_CHECKING:
    from physic_core.types import BoolArray, Keypoints

SeenConfidence = Annotated[
    float,
    Field(ge=0, le=1, description="confidence of keypoints from which their joints count as seen; 0 takes all"),
]
"""Type of a backend's option ``seen_confidence``, the argument ``least`` of :func:`observed_joints`."""

_LIMBS = {name: joint_pair(name) for name in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")}
_FEET, _COLLARS = joint_pair("foot"), joint_pair("collar")
_FINGERS = [[joint for finger in hand for joint in finger] for hand in FINGER_JOINTS]
_PELVIS, _CHEST = JOINT_INDEX["pelvis"], JOINT_INDEX["spine3"]
_LOWER_SPINE = [JOINT_INDEX[name] for name in ("spine1", "spine2")]
_FACE = [JOINT_INDEX[name] for name in ("neck", "head", "jaw", "left_eye", "right_eye")]


def observed_joints(
    keypoints: Keypoints, height: int, width: int, least: float = 0.5, finger_share: float = 0.5
) -> BoolArray | None:
    """Return which SMPL-X joints have confident keypoints inside the image.

    Joints without a keypoint depend on other joints: collars on shoulders; the foot's joint on heel or toes; neck,
    head, jaw and eyes on nose, eyes or ears; the pelvis on a hip, the chest on a shoulder, the spine between them on
    both; fingers on a share of the hand's points and the wrist, or on the wrist alone.

    Args:
        keypoints: of N people.
        height: of the image, px.
        width: of the image, px.
        least: minimum confidence of a visible keypoint.
        finger_share: minimum share of a hand's points that are visible if its fingers are; 0 uses the wrist alone.

    Returns:
        (N, 55) bool, or None if the skeleton lacks a shoulder, elbow, wrist, hip, knee or ankle.
    """
    row = {name: i for i, name in enumerate(keypoints.joint_set.names)}
    if not all(f"{side}_{joint}" in row for joint in _LIMBS for side in SIDES):
        return None
    inside = (keypoints.points > -0.5) & (keypoints.points < np.array([width, height]) - 0.5)
    seen: BoolArray = np.asarray(inside.all(axis=-1) & (keypoints.confidence >= least))

    def seen_of(*names: str) -> BoolArray:
        return seen[:, [row[name] for name in names if name in row]]

    observed: BoolArray = np.zeros((len(seen), NUM_JOINTS), bool)
    for k, side in enumerate(SIDES):
        for joint, pair in _LIMBS.items():
            observed[:, pair[k]] = seen[:, row[f"{side}_{joint}"]]
        wrist: BoolArray = observed[:, _LIMBS["wrist"][k]]
        ankle: BoolArray = observed[:, _LIMBS["ankle"][k]]
        foot = seen_of(*(f"{side}_{name}" for name in ("big_toe", "small_toe", "heel", "foot_tip")))
        hand = seen_of(*(name for name in row if name.startswith(side) and (is_finger(name) or "hand_root" in name)))
        observed[:, _FEET[k]] = foot.any(axis=1) if foot.shape[1] else ankle
        observed[:, _COLLARS[k]] = observed[:, _LIMBS["shoulder"][k]]
        share = hand.mean(axis=1, keepdims=True) if hand.shape[1] else np.ones((len(seen), 1))
        observed[:, _FINGERS[k]] = np.logical_and(wrist[:, None], share >= finger_share)
    face = seen_of("nose", *(f"{side}_{name}_surface" for side in SIDES for name in ("eye", "ear")))
    shoulders, hips = (observed[:, _LIMBS[name]].any(axis=1) for name in ("shoulder", "hip"))
    observed[:, _FACE] = face.any(axis=1, keepdims=True)
    observed[:, _PELVIS], observed[:, _CHEST] = hips, shoulders
    observed[:, _LOWER_SPINE] = np.asarray(hips & shoulders)[:, None]
    return observed
