"""Where the photo shows no legs, left and right are more likely alike than a body estimator guesses."""

from __future__ import annotations

from torch import Tensor

from physic_core.body.joints import JOINT_INDEX

__all__ = ["leg_asymmetry"]

_LEFT_LEG, _RIGHT_LEG = (
    [JOINT_INDEX[f"{side}_{name}"] for name in ("hip", "knee", "ankle")] for side in ("left", "right")
)
_ALIKE_SIGMA = 0.25  # radians that legs of people are apart


def leg_asymmetry(rotations: Tensor) -> Tensor:
    """How unlike the legs are bent: ``sum_j 2 (1 - cos a_j) / sigma^2`` over hips, knees and ankles, where a_j is the
    angle from the mirrored right joint to the left one: (B, 55, 3, 3) -> (B,)."""
    flip = rotations.new_tensor([1.0, -1.0, -1.0])
    mirrored = rotations[:, _RIGHT_LEG] * flip[:, None] * flip
    return (rotations[:, _LEFT_LEG] - mirrored).square().sum((-1, -2, -3)) / (2 * _ALIKE_SIGMA**2)
