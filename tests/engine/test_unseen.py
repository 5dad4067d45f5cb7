"""What photos do not show."""

from __future__ import annotations

import math
from dataclasses import replace

import torch

from physic_core import engine_preset
from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.solve import optimize
from physic_core.engine.joint.terms import reprojection_and_depth
from physic_core.geometry.rotvecs import rotvec_to_rotmat

from .adjusted import (
    adjusted,
    heights,
    posed,
    with_result,
    with_scene,
    without_joints,
)

SETTINGS = engine_preset("default").joint


def lifted(stage, height):
    """The left foot ``height`` metres over the floor, and the photo shows neither knee nor ankle of
    that leg.
    """
    hidden = without_joints(stage.state, "knee", "ankle", "foot", sides=("left",))
    bend = math.acos(1 - height / 0.8)
    turns = torch.zeros(55, 3)
    for joint, share in (("left_hip", -1), ("left_knee", 2), ("left_ankle", -1)):
        turns[JOINT_INDEX[joint], 0] = share * bend
    return replace(hidden, rotations=hidden.rotations @ rotvec_to_rotmat(turns))


def sole_height(state):
    """Metres of the lowest vertex of the left sole over the floor."""
    return float(heights(state)[0, state.model.contact_sets["left_sole"]].min())


def test_an_unseen_foot_that_hovers_comes_down(standing, monkeypatch):
    monkeypatch.setattr(reprojection_and_depth, "INVISIBLE_WEIGHT", 0.0)
    state = lifted(standing, 0.06)
    assert 0.03 < sole_height(with_result(state, posed(state))) < 0.1
    free = adjusted(SETTINGS, soles__unseen_weight=0.0)
    pulled, left = (sole_height(optimize(state, settings)) for settings in (SETTINGS, free))
    assert pulled < left - 0.02
    assert left > 0.03


def test_a_person_without_a_floor_may_be_nearer_than_depth_says(standing):
    state = with_scene(standing.state, floor=None)
    assert "offset" in JointEnergy(state, SETTINGS).variables.free
    tied = JointEnergy(state, adjusted(SETTINGS, depth__offset_alone_sigma=0.0))
    assert "offset" not in tied.variables.free
