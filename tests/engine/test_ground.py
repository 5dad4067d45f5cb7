"""A floor that contradicts the people on it is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from physic_core.engine.scene.floor_below_people import wrong_floor
from physic_core.geometry.floor import PlaneFit
from physic_core.geometry.rotations import rotvec_to_rotmat

FLOOR_Y = 1.3  # of the stage
TURN = rotvec_to_rotmat(torch.tensor([math.radians(12.0), 0.0, math.radians(-4.0)]))
"""The camera looks down by 12 degrees and is held a little askew."""
UP = TURN @ torch.tensor([0.0, -1.0, 0.0])
NO_NORMALS = torch.zeros(0, 3)


@pytest.fixture(scope="module")
def people(make_stage):
    """Two who stand on one floor: vertices, joints, soles."""
    stage = make_stage([({}, (-0.5, 0.0, 3.0)), ({}, (0.5, 0.0, 3.5))])
    sets = stage.problem.model.contact_sets
    return stage.vertices @ TURN.T, stage.joints @ TURN.T, torch.cat([sets["left_sole"], sets["right_sole"]])


def room(tables=300, wall=1200):
    """A wall and a table top in front of the people, normals off by 3 degrees: points, normals."""
    generator = torch.Generator().manual_seed(0)

    def spread(count, low, high):
        low, high = torch.tensor(low), torch.tensor(high)
        return low + torch.rand(count, 3, generator=generator) * (high - low)

    points = torch.cat([spread(wall, (-3.0, -1.0, 6.0), (3.0, 1.0, 6.0)), spread(tables, (-1, 0.6, 2), (1, 0.6, 2.4))])
    normals = torch.tensor([[0.0, 0.0, -1.0]] * wall + [[0.0, -1.0, 0.0]] * tables)
    noise = rotvec_to_rotmat(math.radians(3.0) * torch.randn(wall + tables, 3, generator=generator))
    return points @ TURN.T, (noise @ normals[..., None])[..., 0] @ TURN.T


def shifted(people, who, by):
    """One of them, by so many metres upwards."""
    vertices, joints, soles = people
    up = torch.zeros(len(vertices), 1, 1)
    up[who] = by
    return vertices + up * UP, joints + up * UP, soles


def test_a_plane_through_everybody_is_a_table_and_one_through_some_is_not(people):
    vertices, joints, soles = people
    floor = -float((vertices[:, soles] @ UP).min())
    fit = PlaneFit(UP, floor, torch.ones(2, 2, dtype=torch.bool), 0.5, 0.0, "lower image")
    assert wrong_floor(fit, vertices, joints, NO_NORMALS) is None
    assert wrong_floor(replace(fit, offset=floor - 0.1), vertices, joints, NO_NORMALS) is None
    table = replace(fit, offset=floor - 0.8)
    assert wrong_floor(table, vertices, joints, NO_NORMALS) == "through_people"
    raised = shifted(people, 1, 1.0)[0]
    assert wrong_floor(table, raised, joints, NO_NORMALS) is None
    assert wrong_floor(table, vertices[:0], joints[:0], NO_NORMALS) is None


def test_a_floor_of_a_mask_is_never_taken_for_furniture(people):
    vertices, joints, soles = people
    table = -float((vertices[:, soles] @ UP).min()) - 0.8
    fit = PlaneFit(UP, table, torch.ones(2, 2, dtype=torch.bool), 0.5, 0.0, "lower image")
    assert wrong_floor(fit, vertices, joints, NO_NORMALS) == "through_people"
    assert wrong_floor(replace(fit, source="floor mask"), vertices, joints, NO_NORMALS) is None


def test_a_floor_metres_below_all_people_is_refused(people):
    vertices, joints, soles = people
    under = -float((vertices[:, soles] @ UP).min())
    deep = 0.8 + 0.15 * float(vertices[..., 2].mean(1).max())
    fit = PlaneFit(UP, under, torch.ones(2, 2, dtype=torch.bool), 0.5, 0.0, "floor mask")
    assert wrong_floor(fit, vertices, joints, NO_NORMALS) is None
    assert wrong_floor(replace(fit, offset=under + 0.6), vertices, joints, NO_NORMALS) is None
    assert wrong_floor(replace(fit, offset=under + deep + 0.1), vertices, joints, NO_NORMALS) == "far_below_people"
    assert (
        wrong_floor(replace(fit, offset=under - 0.8, source="lower image"), vertices, joints, NO_NORMALS)
        == "through_people"
    )
    assert wrong_floor(None, vertices, joints, NO_NORMALS) is None
    assert wrong_floor(fit, vertices[:0], joints[:0], NO_NORMALS) is None


def tilted(degrees, under):
    """A floor through the feet that is tilted about the camera's x axis."""
    normal = rotvec_to_rotmat(torch.tensor([math.radians(degrees), 0.0, 0.0])) @ UP
    return PlaneFit(normal, under, torch.ones(2, 2, dtype=torch.bool), 0.5, 0.0, "floor mask")


@pytest.mark.parametrize(("degrees", "reason"), [(0.0, None), (25.0, None), (60.0, "tilted"), (-60.0, "tilted")])
def test_a_floor_that_people_who_stand_contradict_is_refused(people, degrees, reason):
    vertices, joints, _ = people
    floor = tilted(degrees, float((-(vertices @ tilted(degrees, 0.0).normal)).amax(1).max()) + 0.2)
    assert wrong_floor(floor, vertices, joints, NO_NORMALS) == reason


def test_people_who_lie_or_look_lost_do_not_contradict_a_floor(people):
    vertices, joints, _ = people
    lying = rotvec_to_rotmat(torch.tensor([0.0, 0.0, math.radians(90.0)]))
    floor = tilted(0.0, float((-(vertices @ lying.T @ UP)).amax(1).max()))
    assert wrong_floor(floor, vertices @ lying.T, joints @ lying.T, NO_NORMALS) is None
    assert wrong_floor(floor, vertices @ lying.T, torch.full_like(joints, torch.nan), NO_NORMALS) is None


def test_a_floor_that_the_other_surfaces_contradict_is_refused(people):
    vertices, joints, _ = people
    _, normals = room()
    for degrees, reason in ((0.0, None), (20.0, None), (35.0, "tilted")):
        floor = tilted(degrees, float((-(vertices @ tilted(degrees, 0.0).normal)).amax(1).max()) + 0.2)
        assert wrong_floor(floor, vertices, joints, normals) == reason
