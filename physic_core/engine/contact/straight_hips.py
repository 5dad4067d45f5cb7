"""Arms near the thigh of a straight hip: who stands or lies rarely touches the thigh, though many poses are near it."""

from __future__ import annotations

import torch
from torch import Tensor

from physic_core.body.joints import SIDES
from physic_core.body.model import BodyModel
from physic_core.engine.joint.limbs import straight_hips

__all__ = ["arms_at_straight_hips"]

_ARM = ("hand", "lower_arm")


def arms_at_straight_hips(model: BodyModel, joints: Tensor, nearest: Tensor) -> Tensor:
    """Return the vertices (N, V) bool of arms and thighs that are nearest to each other, at a straight hip.

    Args:
        model: body model.
        joints: (N, 55, 3) metres.
        nearest: (N, V) int64, nearest vertex of another part of the own body.
    """
    part, names = model.part_of_vertex, model.part_names
    flagged = torch.zeros_like(nearest, dtype=torch.bool)
    for side, straight in zip(SIDES, straight_hips(joints).unbind(-1), strict=True):
        arm = torch.isin(part, part.new_tensor([names.index(f"{side}_{name}") for name in _ARM]))
        thigh = part == names.index(f"{side}_upper_leg")
        flagged |= straight[:, None] & ((arm & thigh[nearest]) | (thigh & arm[nearest]))
    return flagged
