"""Correct left-right swaps of detected arm or leg keypoints.

A body fitted to swapped keypoints twists its trunk.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.body.joints import SIDES
from physic_core.types import Skeleton

__all__ = ["LIMB_PAIRS", "CorrectedSides", "fix_left_right_swaps"]

_FINGERS = tuple(f"{f}{k}" for f in ("thumb", "index", "middle", "ring", "pinky") for k in ("1", "2", "3", "_tip"))
LIMB_PAIRS: dict[str, tuple[str, ...]] = {
    "arms": ("elbow", "wrist", "hand_root", *_FINGERS),
    "legs": ("knee", "ankle", "heel", "big_toe", "small_toe", "foot_tip"),
}
"""Keypoints of each pair of limbs that are swapped together; shoulders and hips are not swapped."""

_LEAST = 0.1  # least mean difference, as a share of the person's size


@dataclass(frozen=True)
class CorrectedSides:
    """Index of the detected keypoint for each body landmark, after the correction of left-right swaps.

    Attributes:
        order: (B, J) int64, index of the detected keypoint for each landmark of the body.
        exchanged: per person, the pairs of limbs whose left and right are exchanged.
    """

    order: Tensor
    exchanged: tuple[tuple[str, ...], ...]


def fix_left_right_swaps(
    skeleton: Skeleton, keypoints: Tensor, confidence: Tensor, expected: Tensor, most_deg: float
) -> CorrectedSides:
    """Exchange left and right keypoints of arms or legs that a detector has swapped.

    A swap reverses the directions from left to right keypoints relative to those of the body. If both arms and legs of
    a person look swapped, none are exchanged: either the body or the keypoints face the wrong way.

    Args:
        skeleton: of the J keypoints.
        keypoints: (B, J, 2) px.
        confidence: (B, J).
        expected: (B, J, 2) px, projected landmarks of the placed bodies.
        most_deg: largest weighted mean angle between the directions without an exchange; 180 exchanges nothing.
    """
    people, count = confidence.shape
    order = torch.arange(count, device=keypoints.device).expand(people, -1).clone()
    row = {name: j for j, name in enumerate(skeleton.names)}
    limbs = {
        pair: tuple([row[f"{side}_{p}"] for p in points if f"{side}_{p}" in row] for side in SIDES)
        for pair, points in LIMB_PAIRS.items()
    }
    exchanged: list[tuple[str, ...]] = []
    for person, (found, body, sure) in enumerate(zip(keypoints, expected, confidence, strict=True)):
        finite = torch.isfinite(body).all(-1)
        sure = torch.where(finite & torch.isfinite(found).all(-1), sure, 0.0)
        size = (body[finite].amax(0) - body[finite].amin(0)).max() if bool(finite.any()) else body.new_zeros(())
        swapped = tuple(
            pair
            for pair, (left, right) in limbs.items()
            if most_deg < 180
            and _is_swapped(
                found[right] - found[left],
                body[right] - body[left],
                torch.minimum(sure[left], sure[right]),
                size,
                most_deg,
            )
        )
        if len(swapped) == len(LIMB_PAIRS):
            swapped = ()
        for left, right in (limbs[pair] for pair in swapped):
            order[person, [*left, *right]] = torch.as_tensor([*right, *left], device=order.device)
        exchanged.append(swapped)
    return CorrectedSides(order, tuple(exchanged))


def _is_swapped(found: Tensor, body: Tensor, weight: Tensor, size: Tensor, most_deg: float) -> bool:
    """Return whether directions (n, 2) of keypoints oppose the body's (n, 2), with weights (n,)."""
    found, body = (torch.where(weight[:, None] > 0, directions, 0.0) for directions in (found, body))
    along = (weight * (found * body).sum(-1)).sum()
    lengths = (weight * found.norm(dim=-1) * body.norm(dim=-1)).sum()
    away = (weight * (found - body).norm(dim=-1)).sum()
    return bool(along < math.cos(math.radians(most_deg)) * lengths) and bool(away > _LEAST * size * weight.sum())
