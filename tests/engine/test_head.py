"""How stage 3 turns heads to where the faces look."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from physic_core import engine_preset
from physic_core.body.bones import head_direction
from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.joint.solve import optimize

from .adjusted import adjusted

SETTINGS = engine_preset("default").joint


def facing(state, turn, sigma):
    """The state with a face that looks ``turn`` rad to the side of the head."""
    look = head_direction(state.rotations)
    cos, sin = np.cos(turn), np.sin(turn)
    sideways = look.new_tensor([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    return replace(state, head=look @ sideways.T, head_sigma=look.new_tensor([sigma]))


def off(state, other):
    """Radians between the heads of two states."""
    cosine = (
        head_direction(state.rotations) * head_direction(other.rotations).to(state.rotations)
    ).sum()
    return float(torch.acos(cosine.clamp(-1, 1)))


def test_neck_and_head_turn_towards_the_face_by_equal_shares(standing):
    told = facing(standing.state, 0.4, 0.05)
    found = optimize(told, SETTINGS)
    assert off(found, standing.state) == pytest.approx(0.4, abs=0.15)
    before = standing.state.rotations.to(found.rotations)
    turns = [
        float(torch.acos((((before[0, j].T @ found.rotations[0, j]).trace() - 1) / 2).clamp(-1, 1)))
        for j in (JOINT_INDEX["neck"], JOINT_INDEX["head"])
    ]
    assert turns[0] == pytest.approx(turns[1], rel=0.3)


def test_without_a_face_nothing_changes(standing):
    short = adjusted(SETTINGS, optimiser__steps=5)
    unknown = facing(standing.state, 0.4, torch.nan)
    plain = optimize(replace(standing.state, head=None, head_sigma=None), short)
    assert torch.equal(plain.joints, optimize(unknown, short).joints)
