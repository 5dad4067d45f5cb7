"""Results of detectors and estimators for the people in a photo."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.limbs import detected_joints
from physic_core.types import Skeleton


@dataclass(frozen=True)
class ObservedPeople:
    """Results of detectors and estimators for B people.

    Attributes:
        skeleton: of the J keypoints.
        keypoints: (B, J, 2) px.
        confidence: (B, J) in [0, 1].
        observed: (B, 55) bool, joints that the body estimator reports as visible; None means all.
        masks: (B, H, W) bool, visible pixels of each person.
    """

    skeleton: Skeleton
    keypoints: Tensor
    confidence: Tensor
    observed: Tensor | None
    masks: Tensor


def reported_joints(detections: ObservedPeople, seen_confidence: float) -> Tensor:
    """Return the joints (B, 55) bool that the body estimator or a confident keypoint reports as visible."""
    keypoints = detections.keypoints
    reported = detections.observed
    if reported is None:
        reported = torch.ones((len(keypoints), len(JOINT_INDEX)), dtype=torch.bool)
    masks = detections.masks.to(keypoints.device)
    detected = detected_joints(detections.skeleton, keypoints, detections.confidence, masks, seen_confidence)
    return reported.to(keypoints.device) | detected
