"""Left and right of a pair of limbs, where the keypoints have them the other way round than the body.

Detectors mix up the arms or the legs of a person now and then, and a body that follows them twists its trunk.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.body.joints import SIDES
from physic_core.body.landmarks import SKELETONS

__all__ = ["PAIRS", "Sides", "tell_sides"]

_FINGERS = tuple(f"{f}{k}" for f in ("thumb", "index", "middle", "ring", "pinky") for k in ("1", "2", "3", "_tip"))
PAIRS: dict[str, tuple[str, ...]] = {
    "arms": ("elbow", "wrist", "hand_root", *_FINGERS),
    "legs": ("knee", "ankle", "heel", "big_toe", "small_toe", "foot_tip"),
}
"""Pair of limbs -> points that are mixed up together: shoulders and hips keep their sides."""

_LEAST = 0.1  # of the person: a smaller mean difference is no reason to exchange anything


@dataclass(frozen=True)
class Sides:
    """Which keypoint each point of the body is to be held against.

    Attributes:
        order: (B, J) int64.
        exchanged: per person, the pairs whose left and right are exchanged in it.
    """

    order: Tensor
    exchanged: tuple[tuple[str, ...], ...]


def tell_sides(skeleton: str, keypoints: Tensor, confidence: Tensor, expected: Tensor, most_deg: float) -> Sides:
    """Exchange left and right of a pair of limbs whose keypoints lie the other way round than the body's.

    What counts is the way from each left point to its right one: keypoints that are mixed up have drawn the body aside
    and have changed its size, but not which way it goes from its left to its right.

    A person whose arms and legs would both be exchanged keeps them as they are: their body is turned the other way,
    and who of the two is right cannot be told from here.

    Args:
        skeleton: name of the joint set; nothing is exchanged in one that no body knows.
        keypoints: (B, J, 2) px.
        confidence: (B, J).
        expected: (B, J, 2) px, where the body's points are seen.
        most_deg: a pair is exchanged where these ways differ by more in the mean, longer ones counting more; 180
            exchanges nothing.
    """
    people, count = confidence.shape
    order = torch.arange(count, device=keypoints.device).expand(people, -1).clone()
    row = {name: j for j, name in enumerate(SKELETONS.get(skeleton, ()))}
    limbs = {
        pair: tuple([row[f"{side}_{p}"] for p in points if f"{side}_{p}" in row] for side in SIDES)
        for pair, points in PAIRS.items()
    }
    exchanged: list[tuple[str, ...]] = []
    for person, (found, body, sure) in enumerate(zip(keypoints, expected, confidence, strict=True)):
        whole = torch.isfinite(body).all(-1)
        sure = torch.where(whole & torch.isfinite(found).all(-1), sure, 0.0)
        size = (body[whole].amax(0) - body[whole].amin(0)).max() if bool(whole.any()) else body.new_zeros(())
        mixed = tuple(
            pair
            for pair, (left, right) in limbs.items()
            if most_deg < 180
            and _mixed(
                found[right] - found[left],
                body[right] - body[left],
                torch.minimum(sure[left], sure[right]),
                size,
                most_deg,
            )
        )
        if len(mixed) == len(PAIRS):
            mixed = ()
        for left, right in (limbs[pair] for pair in mixed):
            order[person, [*left, *right]] = torch.as_tensor([*right, *left], device=order.device)
        exchanged.append(mixed)
    return Sides(order, tuple(exchanged))


def _mixed(found: Tensor, body: Tensor, weight: Tensor, size: Tensor, most_deg: float) -> bool:
    """Whether ways (n, 2) that were found lead away from the body's, by weights (n,), 0 where one is not known."""
    found, body = (torch.where(weight[:, None] > 0, ways, 0.0) for ways in (found, body))
    along = (weight * (found * body).sum(-1)).sum()
    lengths = (weight * found.norm(dim=-1) * body.norm(dim=-1)).sum()
    away = (weight * (found - body).norm(dim=-1)).sum()
    return bool(along < math.cos(math.radians(most_deg)) * lengths) and bool(away > _LEAST * size * weight.sum())
