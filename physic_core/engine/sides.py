"""Left and right of a pair of limbs, where the keypoints have them the other way round than the body.

Detectors mix up the arms or the legs of a person now and then, and a body that follows them twists its trunk.
"""

from __future__ import annotations

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

_ROOTS = {"arms": "shoulder", "legs": "hip"}

_FARTHEST = 0.3  # of the person: an error counts as no larger than this
_LEAST = 0.05  # of the person: a smaller mean error is no reason to exchange anything


@dataclass(frozen=True)
class Sides:
    """Which keypoint each point of the body is to be held against.

    Attributes:
        order: (B, J) int64.
        exchanged: per person, the pairs whose left and right are exchanged in it.
    """

    order: Tensor
    exchanged: tuple[tuple[str, ...], ...]


def tell_sides(skeleton: str, keypoints: Tensor, confidence: Tensor, expected: Tensor, ratio: float) -> Sides:
    """Exchange left and right of a pair of limbs where the body then fits much better.

    Keypoints that are mixed up have drawn the body aside: limbs are held against it from where they begin, with the
    body's shoulders or hips on those of the keypoints.

    A person whose arms and legs would both be exchanged keeps them as they are: their body is turned the other way,
    and who of the two is right cannot be told from here.

    Args:
        skeleton: name of the joint set; nothing is exchanged in one that no body knows.
        keypoints: (B, J, 2) px.
        confidence: (B, J).
        expected: (B, J, 2) px, where the body's points are seen.
        ratio: a pair is exchanged where that lowers its error to this share of what it was; 0 exchanges nothing.
    """
    people, count = confidence.shape
    order = torch.arange(count, device=keypoints.device).expand(people, -1).clone()
    exchanged: list[tuple[str, ...]] = []
    names = SKELETONS.get(skeleton, ())
    row = {name: j for j, name in enumerate(names)}
    usable = torch.isfinite(keypoints).all(-1) & torch.isfinite(expected).all(-1) & (confidence > 0)
    for person in range(people):
        seen = expected[person][torch.isfinite(expected[person]).all(-1)]
        size = (seen.amax(0) - seen.amin(0)).max() if len(seen) else keypoints.new_tensor(0.0)
        mixed: dict[str, tuple[list[int], list[int]]] = {}
        for pair, points in PAIRS.items():
            left, right = ([row[f"{side}_{p}"] for p in points if f"{side}_{p}" in row] for side in SIDES)
            here, there = [*left, *right], [*right, *left]
            known = usable[person, here] & usable[person, there]
            if ratio <= 0 or not bool(known.any()) or not bool(size > 0):
                continue
            found, sure = keypoints[person, here][known], confidence[person, here][known]
            roots = [row[name] for side in SIDES if (name := f"{side}_{_ROOTS[pair]}") in row]
            trust = (confidence[person, roots] * usable[person, roots])[:, None]
            away = torch.nan_to_num(keypoints[person, roots] - expected[person, roots], posinf=0.0, neginf=0.0)
            moved = expected[person] + (trust * away).sum(0) / trust.sum().clamp(min=1e-9)
            kept, other = (
                (sure * ((found - moved[to][known]).norm(dim=-1) / size).clamp(max=_FARTHEST)).sum() / sure.sum()
                for to in (here, there)
            )
            if bool(kept > _LEAST) and bool(other < ratio * kept):
                mixed[pair] = here, there
        if len(mixed) == len(PAIRS):
            mixed = {}
        for here, there in mixed.values():
            order[person, here] = torch.as_tensor(there, device=order.device)
        exchanged.append(tuple(mixed))
    return Sides(order, tuple(exchanged))
