"""Limits of joints: nothing for what people do, and a slope back from what they cannot."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import roma
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from physic_core.body.joints import JOINT_INDEX, JOINT_NAMES
from physic_core.engine.joint.joint_limits import FINGER_RANGES, RANGES, beyond_limits, leg_asymmetry, limits_of
from physic_core.engine.joint.solve import optimize
from physic_core.engine.presets import PRESETS

BOTH = {**RANGES, **FINGER_RANGES}


def beyond_ranges(rotations, ranges):
    return beyond_limits(rotations, limits_of(ranges, rotations))


def turned(name, turn, dtype=torch.float64):
    turns = torch.zeros(1, 55, 3, dtype=dtype)
    turns[0, JOINT_INDEX[name]] = torch.tensor(turn, dtype=dtype)
    return roma.rotvec_to_rotmat(turns)


def slow(rotvecs, ranges):
    """One joint and one axis at a time."""
    total = 0.0
    for joint, name in enumerate(JOINT_NAMES):
        side, _, rest = name.partition("_")
        limits = ranges.get(name) or ranges.get(rest if side in ("left", "right") else "")
        if limits is None:
            continue
        for axis, (low, high) in enumerate(limits):
            value = float(rotvecs[joint, axis])
            if side == "right" and axis > 0:
                value = -value
            total += (max(0.0, low - value) ** 2 + max(0.0, value - high) ** 2) * 12.0**2
    return total


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.1, 2.5))
def test_equals_its_slow_twin(seed, spread):
    turns = torch.randn(55, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    turns = spread * turns / turns.norm(dim=-1, keepdim=True)
    got = beyond_ranges(roma.rotvec_to_rotmat(turns)[None], BOTH).item()
    assert got == pytest.approx(slow(turns, BOTH), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("ranges", [RANGES, FINGER_RANGES], ids=["body", "fingers"])
def test_gradient(ranges):
    turns = 1.3 * torch.randn(2, 55, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    turns = turns.clamp(-1.65, 1.65).requires_grad_()
    assert beyond_ranges(roma.rotvec_to_rotmat(turns), ranges).gt(0).all()
    assert torch.autograd.gradcheck(lambda x: beyond_ranges(roma.rotvec_to_rotmat(x), ranges), turns)


def test_gradient_at_rest_is_zero():
    rest = torch.eye(3).repeat(1, 55, 1, 1).requires_grad_()
    beyond_ranges(rest, BOTH).sum().backward()
    assert torch.equal(rest.grad, torch.zeros_like(rest))


def test_both_sides_are_mirror_images():
    generator = torch.Generator().manual_seed(3)
    left = 2.0 * torch.rand(3, generator=generator, dtype=torch.float64) - 1
    for name in ("shoulder", "hip", "wrist", "index1", "thumb2"):
        for k in range(5):
            turn = (k - 2) * left
            mirrored = turn * torch.tensor([1.0, -1.0, -1.0])
            one = beyond_ranges(turned(f"left_{name}", turn.tolist()), BOTH)
            other = beyond_ranges(turned(f"right_{name}", mirrored.tolist()), BOTH)
            torch.testing.assert_close(one, other)


@pytest.mark.parametrize(
    ("name", "turn"),
    [
        ("left_shoulder", (0.0, 0.0, -1.4)),  # arm hangs
        ("right_shoulder", (0.0, 0.0, -1.5)),  # arm is raised
        ("left_hip", (-2.2, 0.0, 0.0)),  # squat
        ("left_hip", (-1.5, 0.6, 0.9)),  # seat astride
        ("left_index1", (0.0, 0.0, -1.5)),  # fist
        ("right_index2", (0.0, 0.0, 1.8)),
        ("neck", (0.6, 0.8, 0.0)),
        ("right_ankle", (-0.6, 0.0, 0.0)),  # toes up
    ],
)
def test_what_people_do_costs_nothing(name, turn):
    assert beyond_ranges(turned(name, turn), BOTH).item() == 0


@pytest.mark.parametrize(
    ("name", "turn"),
    [
        ("left_hip", (1.6, 0.0, 0.0)),  # thigh straight backwards
        ("left_index1", (0.0, 0.0, 1.6)),  # finger backwards
        ("right_index2", (0.0, 0.0, -1.0)),
        ("left_middle2", (0.0, 1.0, 0.0)),  # finger sideways in its middle joint
        ("neck", (0.0, 2.2, 0.0)),  # head to the back
        ("left_shoulder", (0.0, 2.0, 0.0)),  # arm straight backwards
        ("right_ankle", (2.0, 0.0, 0.0)),
    ],
)
def test_what_people_cannot_costs_and_the_slope_leads_back(name, turn):
    axis = max(range(3), key=lambda k: abs(turn[k]))
    turns = torch.zeros(1, 55, 3, dtype=torch.float64)
    turns[0, JOINT_INDEX[name]] = torch.tensor(turn, dtype=torch.float64)
    turns.requires_grad_()
    cost = beyond_ranges(roma.rotvec_to_rotmat(turns), BOTH)
    cost.sum().backward()
    assert cost.item() > 5
    assert turns.grad[0, JOINT_INDEX[name], axis] * turn[axis] > 0


def test_fingers_that_start_backwards_come_back(make_stage):
    bends = {f"left_{finger}1": (0.0, 0.0, 1.3) for finger in ("index", "middle", "ring", "pinky")}
    problem = make_stage([(bends, (0.0, 0.0, 3.5))]).problem
    joint = replace(PRESETS["default"].joint, steps=30)

    def knuckle(result):
        return roma.rotmat_to_rotvec(result.rotations[0, JOINT_INDEX["left_index1"]])[2].item()

    free, held = optimize(problem, joint), optimize(problem, replace(joint, finger_weight=1.0))
    print(f"backwards by {math.degrees(knuckle(free)):.0f} degrees, {math.degrees(knuckle(held)):.0f} with limits")
    assert knuckle(free) > 1.2
    assert knuckle(held) < 1.0
    assert held.losses["fingers"][1] < 0.3 * held.losses["fingers"][0]


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
