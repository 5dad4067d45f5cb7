"""Arms that hang straight down beside the thigh of the same side: near it in every such pose, and rarely in contact."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX, SIDES
from physic_core.body.model import BodyModel

__all__ = ["beside_hanging_arm", "hanging_arms"]

_ALONG_THIGH = math.cos(math.radians(30.0))  # of the lower arm: on worlds, arms that rest on a thigh differ by more
_STRAIGHT_ELBOW = math.cos(math.radians(60.0))
_STRAIGHT_HIP = math.cos(math.radians(30.0))  # who sits or bends forward rests the hands on the thighs
_NEAR_THE_THIGH = ("hand", "lower_arm")


def hanging_arms(joints: Tensor) -> Tensor:
    """Return which arms (N, 2) bool, left and right, hang along the straight thigh of their side.

    Args:
        joints: (N, 55, 3) metres.
    """
    found = []
    for side in SIDES:
        upper, lower, thigh = (
            _direction(joints, f"{side}_{start}", f"{side}_{end}")
            for start, end in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"))
        )
        trunk = _direction(joints, "neck", "pelvis")
        along = (lower * thigh).sum(-1) > _ALONG_THIGH
        found.append(along & ((upper * lower).sum(-1) > _STRAIGHT_ELBOW) & ((trunk * thigh).sum(-1) > _STRAIGHT_HIP))
    return torch.stack(found, -1)


def beside_hanging_arm(model: BodyModel, joints: Tensor, nearest: Tensor) -> Tensor:
    """Return the vertices (N, V) bool of a hanging arm whose nearest skin is on that thigh, and those of the thigh.

    Args:
        model: body model.
        joints: (N, 55, 3) metres.
        nearest: (N, V) int64, nearest vertex of another part of the own body.
    """
    part, names = model.part_of_vertex, model.part_names
    flagged = torch.zeros_like(nearest, dtype=torch.bool)
    for side, hangs in zip(SIDES, hanging_arms(joints).unbind(-1), strict=True):
        arm = torch.isin(part, part.new_tensor([names.index(f"{side}_{name}") for name in _NEAR_THE_THIGH]))
        thigh = part == names.index(f"{side}_upper_leg")
        flagged |= hangs[:, None] & ((arm & thigh[nearest]) | (thigh & arm[nearest]))
    return flagged


def _direction(joints: Tensor, start: str, end: str) -> Tensor:
    """Return the unit directions (N, 3) from one joint to another."""
    return F.normalize(joints[:, JOINT_INDEX[end]] - joints[:, JOINT_INDEX[start]], dim=-1)
