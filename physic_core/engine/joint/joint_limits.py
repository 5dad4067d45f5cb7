"""How far joints turn: soft one-sided limits on rotation vectors, wide enough that no healthy pose meets them.

Joint frames are those of the T-pose (x to the body's left, y up, z forward). Ranges are of the left side; the right
side is its mirror image. Knees and elbows are hinges: :func:`physic_core.engine.joint.terms.joint_limits` holds them.
"""

from __future__ import annotations

from dataclasses import dataclass

import roma
import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX

__all__ = ["FINGER_RANGES", "RANGES", "Limits", "Ranges", "beyond_limits", "leg_asymmetry", "limits_of"]

Ranges = dict[str, tuple[tuple[float, float], tuple[float, float], tuple[float, float]]]
"""Joint of the middle or of the left side -> lowest and highest turn about x, y and z, radians."""

RANGES: Ranges = {
    # x bends forward (+) at the spine, lifts the thigh (-), the toes (-); z raises arms and spreads legs (+).
    "hip": ((-2.6, 0.8), (-1.2, 1.2), (-0.9, 1.4)),
    "ankle": ((-0.9, 1.1), (-0.7, 0.7), (-0.7, 0.7)),
    "foot": ((-1.0, 0.7), (-0.4, 0.4), (-0.4, 0.4)),
    "spine1": ((-0.7, 1.2), (-0.7, 0.7), (-0.6, 0.6)),
    "spine2": ((-0.7, 1.0), (-0.7, 0.7), (-0.6, 0.6)),
    "spine3": ((-0.7, 1.0), (-0.7, 0.7), (-0.6, 0.6)),
    "neck": ((-0.9, 1.0), (-1.0, 1.0), (-0.7, 0.7)),
    "head": ((-0.9, 0.9), (-1.0, 1.0), (-0.7, 0.7)),
    "collar": ((-0.5, 0.5), (-0.7, 0.5), (-0.5, 0.8)),
    "shoulder": ((-2.0, 2.0), (-2.4, 1.3), (-1.9, 1.7)),
    "wrist": ((-1.6, 1.6), (-1.0, 1.0), (-1.5, 1.5)),
}
"""Body joints that are no hinges."""

_KNUCKLE = ((-0.4, 0.4), (-0.5, 0.5), (-1.8, 0.7))
_MIDDLE = ((-0.3, 0.3), (-0.3, 0.3), (-2.0, 0.3))
_TIP = ((-0.3, 0.3), (-0.3, 0.3), (-1.6, 0.5))
FINGER_RANGES: Ranges = {
    # A left finger points along x and bends about -z; thumbs turn about all axes.
    **{
        f"{finger}{k}": limits
        for finger in ("index", "middle", "ring", "pinky")
        for k, limits in ((1, _KNUCKLE), (2, _MIDDLE), (3, _TIP))
    },
    "thumb1": ((-1.2, 1.2), (-1.2, 1.2), (-1.2, 1.2)),
    "thumb2": ((-0.9, 0.9), (-1.2, 1.2), (-1.2, 1.2)),
    "thumb3": ((-0.9, 0.9), (-1.5, 1.5), (-1.5, 1.5)),
}
"""Finger joints."""

_LEFT_LEG, _RIGHT_LEG = (
    [JOINT_INDEX[f"{side}_{name}"] for name in ("hip", "knee", "ankle")] for side in ("left", "right")
)
_ALIKE_SIGMA = 0.25  # radians that legs of people are apart
_SIGMA = 1.0 / 12.0  # radians, about 5 degrees


@dataclass(frozen=True)
class Limits:
    """A table of ranges, both sides.

    Attributes:
        joints: (n,) int64.
        low: (n, 3) radians.
        high: (n, 3) radians.
    """

    joints: Tensor
    low: Tensor
    high: Tensor


def limits_of(ranges: Ranges, like: Tensor) -> Limits:
    """Ranges as tensors, of the float type and on the device of ``like``."""
    rows: list[int] = []
    spans: list[tuple[tuple[float, float], ...]] = []
    for name, (x, y, z) in ranges.items():
        if name in JOINT_INDEX:
            rows.append(JOINT_INDEX[name])
            spans.append((x, y, z))
            continue
        rows += [JOINT_INDEX[f"left_{name}"], JOINT_INDEX[f"right_{name}"]]
        spans += [(x, y, z), (x, (-y[1], -y[0]), (-z[1], -z[0]))]
    table = torch.tensor(spans, dtype=like.dtype, device=like.device)
    return Limits(torch.tensor(rows, dtype=torch.int64, device=like.device), table[..., 0], table[..., 1])


def beyond_limits(rotations: Tensor, limits: Limits) -> Tensor:
    """``sum_j (max(0, low - w)^2 + max(0, w - high)^2) / sigma^2`` over rotation vectors w and their axes.

    Args:
        rotations: (B, 55, 3, 3) local.
        limits: which joints, and how far.

    Returns:
        (B,).
    """
    turned: Tensor = roma.rotmat_to_rotvec(rotations[:, limits.joints])
    beyond = torch.relu(limits.low - turned) + torch.relu(turned - limits.high)
    return (beyond / _SIGMA).square().sum((-2, -1))


def leg_asymmetry(rotations: Tensor) -> Tensor:
    """How unlike the legs are bent: ``sum_j 2 (1 - cos a_j) / sigma^2`` over hips, knees and ankles, where a_j is the
    angle from the mirrored right joint to the left one: (B, 55, 3, 3) -> (B,)."""
    flip = rotations.new_tensor([1.0, -1.0, -1.0])
    mirrored = rotations[:, _RIGHT_LEG] * flip[:, None] * flip
    return (rotations[:, _LEFT_LEG] - mirrored).square().sum((-1, -2, -3)) / (2 * _ALIKE_SIGMA**2)
