"""A floor that contradicts the people on it is refused."""

from __future__ import annotations

import math

import pytest
import torch

from physic_core.engine.scene.floor_below_people import wrong_floor
from physic_core.geometry.floor import PlaneFit
from physic_core.geometry.rotations import rotvec_to_rotmat

TURN = rotvec_to_rotmat(torch.tensor([math.radians(12.0), 0.0, math.radians(-4.0)]))
"""The camera looks down by 12 degrees and is held a little askew."""
UP = TURN @ torch.tensor([0.0, -1.0, 0.0])
NO_NORMALS = torch.zeros(0, 3)


@pytest.fixture(scope="module")
def people(make_stage):
    """Two who stand on one floor: vertices, joints, and the offset of that floor."""
    stage = make_stage([({}, (-0.5, 0.0, 3.0)), ({}, (0.5, 0.0, 3.5))])
    vertices = stage.vertices @ TURN.T
    return vertices, stage.joints @ TURN.T, -float((vertices @ UP).min())


def plane(offset, source, normal=UP):
    return PlaneFit(normal, offset, torch.ones(2, 2, dtype=torch.bool), 0.5, 0.0, source)


def test_a_plane_through_everybody_is_a_table_and_one_through_some_is_not(people):
    vertices, joints, floor = people
    assert wrong_floor(plane(floor, "lower image"), vertices, joints, NO_NORMALS) is None
    assert wrong_floor(plane(floor - 0.1, "lower image"), vertices, joints, NO_NORMALS) is None
    table = plane(floor - 0.8, "lower image")
    assert wrong_floor(table, vertices, joints, NO_NORMALS) == "through_people"
    assert wrong_floor(plane(floor - 0.8, "floor mask"), vertices, joints, NO_NORMALS) is None
    raised = vertices + torch.tensor([0.0, 1.0])[:, None, None] * UP
    assert wrong_floor(table, raised, joints, NO_NORMALS) is None
    assert wrong_floor(table, vertices[:0], joints[:0], NO_NORMALS) is None


def test_a_floor_metres_below_all_people_is_refused(people):
    vertices, joints, floor = people
    deep = 0.8 + 0.15 * float(vertices[..., 2].mean(1).max())
    for below, reason in ((0.0, None), (0.6, None), (deep + 0.1, "far_below_people")):
        assert wrong_floor(plane(floor + below, "floor mask"), vertices, joints, NO_NORMALS) == reason
    assert wrong_floor(None, vertices, joints, NO_NORMALS) is None


def tilted(degrees, vertices):
    """A floor 20 cm below the lowest feet that is tilted about the camera's x axis."""
    normal = rotvec_to_rotmat(torch.tensor([math.radians(degrees), 0.0, 0.0])) @ UP
    return plane(float(-(vertices @ normal).min()) + 0.2, "floor mask", normal)


@pytest.mark.parametrize(("degrees", "reason"), [(0.0, None), (25.0, None), (60.0, "tilted"), (-60.0, "tilted")])
def test_a_floor_that_people_who_stand_contradict_is_refused(people, degrees, reason):
    vertices, joints, _ = people
    assert wrong_floor(tilted(degrees, vertices), vertices, joints, NO_NORMALS) == reason


def test_people_who_lie_or_look_lost_do_not_contradict_a_floor(people):
    lying = rotvec_to_rotmat(torch.tensor([0.0, 0.0, math.radians(90.0)]))
    vertices, joints = (points @ lying.T for points in people[:2])
    floor = tilted(0.0, vertices)
    assert wrong_floor(floor, vertices, joints, NO_NORMALS) is None
    assert wrong_floor(floor, vertices, torch.full_like(joints, torch.nan), NO_NORMALS) is None


@pytest.mark.parametrize(("degrees", "reason"), [(0.0, None), (20.0, None), (35.0, "tilted")])
def test_a_floor_that_the_other_surfaces_contradict_is_refused(people, degrees, reason):
    """A wall and a table top, their normals off by 3 degrees."""
    vertices, joints, _ = people
    normals = torch.tensor([[0.0, 0.0, -1.0]] * 1200 + [[0.0, -1.0, 0.0]] * 300)
    noise = math.radians(3.0) * torch.randn(1500, 3, generator=torch.Generator().manual_seed(0))
    noisy = (rotvec_to_rotmat(noise) @ normals[..., None])[..., 0] @ TURN.T
    assert wrong_floor(tilted(degrees, vertices), vertices, joints, noisy) == reason
