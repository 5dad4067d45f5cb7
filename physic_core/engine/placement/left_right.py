"""Correct left-right swaps of detected arm or leg keypoints.

Keypoint detectors sometimes swap sides, and a body fitted to swapped keypoints twists its trunk.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.body.joints import SIDES
from physic_core.types import Skeleton

__all__ = ["PAIRS", "Sides", "fix_left_right_swaps"]

_FINGERS = tuple(f"{f}{k}" for f in ("thumb", "index", "middle", "ring", "pinky") for k in ("1", "2", "3", "_tip"))
PAIRS: dict[str, tuple[str, ...]] = {
    "arms": ("elbow", "wrist", "hand_root", *_FINGERS),
    "legs": ("knee", "ankle", "heel", "big_toe", "small_toe", "foot_tip"),
}
"""Pair of limbs -> points that are swapped together: shoulders and hips are not swapped."""

_LEAST = 0.1  # of the person's size: smaller mean differences are ignored


@dataclass(frozen=True)
class Sides:
    """Keypoints after left and right are corrected.

    Attributes:
        order: (B, J) int64, for each point of the body its column among the detected keypoints.
        exchanged: per person, the pairs of limbs whose left and right are exchanged.
    """

    order: Tensor
    exchanged: tuple[tuple[str, ...], ...]


def fix_left_right_swaps(
    skeleton: Skeleton, keypoints: Tensor, confidence: Tensor, expected: Tensor, most_deg: float
) -> Sides:
    """Exchange the left and right keypoints of a pair of limbs that a detector has swapped.

    The directions from each left point to its right one are compared with those of the body. Swapped keypoints change
    the position and size of the placed body, but not its direction from left to right.

    If both arms and legs of a person would be exchanged, none are: the body then faces the other way, and it is unknown
    whether the body or the keypoints are wrong.

    Args:
        skeleton: of the J keypoints.
        keypoints: (B, J, 2) px.
        confidence: (B, J).
        expected: (B, J, 2) px, projected points of the placed bodies.
        most_deg: a pair is exchanged where the mean of these directions differs by more, weighted by their length; 180
            exchanges nothing.
    """
    people, count = confidence.shape
    order = torch.arange(count, device=keypoints.device).expand(people, -1).clone()
    row = {name: j for j, name in enumerate(skeleton.names)}
    limbs = {
        pair: tuple([row[f"{side}_{p}"] for p in points if f"{side}_{p}" in row] for side in SIDES)
        for pair, points in PAIRS.items()
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
        if len(swapped) == len(PAIRS):
            swapped = ()
        for left, right in (limbs[pair] for pair in swapped):
            order[person, [*left, *right]] = torch.as_tensor([*right, *left], device=order.device)
        exchanged.append(swapped)
    return Sides(order, tuple(exchanged))


def _is_swapped(found: Tensor, body: Tensor, weight: Tensor, size: Tensor, most_deg: float) -> bool:
    """Whether directions (n, 2) of keypoints oppose the body's (n, 2), by weights (n,), 0 where one is unknown."""
    found, body = (torch.where(weight[:, None] > 0, ways, 0.0) for ways in (found, body))
    along = (weight * (found * body).sum(-1)).sum()
    lengths = (weight * found.norm(dim=-1) * body.norm(dim=-1)).sum()
    away = (weight * (found - body).norm(dim=-1)).sum()
    return bool(along < math.cos(math.radians(most_deg)) * lengths) and bool(away > _LEAST * size * weight.sum())
