"""Results of detectors and estimators for the people in a photo."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from physic_core.types import Skeleton


@dataclass(frozen=True)
class ObservedPeople:
    """Results of detectors and estimators for B people.

    Attributes:
        skeleton: of the J keypoints.
        keypoints: (B, J, 2) px.
        confidence: (B, J) in [0, 1].
        observed: (B, 55) bool, joints that the body estimator reports as visible.
        masks: (B, H, W) bool, visible pixels of each person.
    """

    skeleton: Skeleton
    keypoints: Tensor
    confidence: Tensor
    observed: Tensor
    masks: Tensor
