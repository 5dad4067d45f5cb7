"""Legs that the photo does not show: nothing for mirrored ones, the square of the angle for others."""

from __future__ import annotations

import pytest
import roma
import torch

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.joint.terms.leg_symmetry import leg_asymmetry


def test_mirrored_legs_are_alike_and_others_cost_the_square_of_their_angle():
    turns = 0.5 * torch.randn(3, 55, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    for name in ("hip", "knee", "ankle"):
        left, right = JOINT_INDEX[f"left_{name}"], JOINT_INDEX[f"right_{name}"]
        turns[:, right] = turns[:, left] * torch.tensor([1.0, -1.0, -1.0])
    assert leg_asymmetry(roma.rotvec_to_rotmat(turns)).abs().max() < 1e-12
    bent = torch.zeros(1, 55, 3, dtype=torch.float64)
    bent[0, JOINT_INDEX["left_knee"], 0] = 0.1
    assert leg_asymmetry(roma.rotvec_to_rotmat(bent)).item() == pytest.approx((0.1 / 0.25) ** 2, rel=1e-2)
    arms = torch.zeros(1, 55, 3, dtype=torch.float64)
    arms[0, JOINT_INDEX["left_elbow"], 1] = 1.0
    assert leg_asymmetry(roma.rotvec_to_rotmat(arms)).item() == 0.0


def test_gradient_of_unlike_legs_is_exact():
    turns = torch.randn(2, 55, 3, generator=torch.Generator().manual_seed(2), dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda x: leg_asymmetry(roma.rotvec_to_rotmat(x)), turns)
