"""A floor that nobody sees is put under the people who stand on it, or nowhere."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import roma
import torch

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.scene import floor_below_people
from physic_core.engine.scene.floor_below_people import floor_under_people, wrong_floor
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


def ground(people, *, points=None, normals=None):
    made = room()
    points, normals = made[0] if points is None else points, made[1] if normals is None else normals
    return floor_under_people(*people, points, normals)


def shifted(people, who, by):
    """One of them, by so many metres upwards."""
    vertices, joints, soles = people
    up = torch.zeros(len(vertices), 1, 1)
    up[who] = by
    return vertices + up * UP, joints + up * UP, soles


def lying(people, who):
    """One of them turned on their side, about the pelvis."""
    vertices, joints, soles = people
    side = roma.rotvec_to_rotmat(torch.tensor([0.0, 0.0, math.pi / 2]))
    vertices, joints = vertices.clone(), joints.clone()
    pelvis = joints[who, 0].clone()
    vertices[who] = (vertices[who] - pelvis) @ side.T + pelvis
    joints[who] = (joints[who] - pelvis) @ side.T + pelvis
    return vertices, joints, soles


def test_a_person_behind_a_table_has_a_floor_under_the_soles(people):
    up, offset = ground(people)
    assert up.dtype == people[0].dtype
    degrees = math.degrees(math.acos(min(1.0, float(up @ UP))))
    assert degrees < 1
    height = people[0] @ up + offset
    assert height.amin(1).tolist() == pytest.approx([0, 0], abs=0.01)
    # Where the people stand the true floor is as high.
    feet = people[1][:, [JOINT_INDEX["left_ankle"], JOINT_INDEX["right_ankle"]]].flatten(0, 1)
    assert (feet @ up + offset).tolist() == pytest.approx((feet @ UP + FLOOR_Y).tolist(), abs=0.01)


def test_exact_normals_give_the_exact_up(people):
    _, normals = room()
    wall = normals @ UP < 0.5
    exact = torch.where(wall[:, None], TURN @ torch.tensor([0.0, 0.0, -1.0]), UP)
    up, offset = ground(people, normals=exact)
    torch.testing.assert_close(up, UP, atol=1e-5, rtol=0)
    assert offset == pytest.approx(FLOOR_Y, abs=0.01)


def test_people_who_lie_give_no_floor(people):
    assert ground(lying(lying(people, 0), 1)) is None
    _, offset = ground(lying(people, 0))  # the other one stands
    assert offset == pytest.approx(FLOOR_Y, abs=0.02)


def test_people_on_two_heights_have_no_floor_in_common(people):
    assert ground(shifted(people, 1, 0.5)) is None
    _, offset = ground(shifted(people, 1, 0.1))
    assert offset == pytest.approx(FLOOR_Y - 0.05, abs=0.02)
    # Who lies half a metre higher does not object.
    assert ground(shifted(lying(people, 1), 1, 0.5)) is not None


def test_a_scene_that_goes_on_below_denies_the_floor(people):
    points, _ = room()
    deep = points - (0.3 + points @ UP + FLOOR_Y)[:, None] * UP  # 0.3 m below
    few = torch.arange(len(points)) % 100 == 0
    many = torch.arange(len(points)) % 12 == 0
    assert ground(people, points=torch.where(few[:, None], deep, points)) is not None
    assert ground(people, points=torch.where(many[:, None], deep, points)) is None


def test_surfaces_must_tell_which_way_is_up(people, monkeypatch):
    points, normals = room()
    unknown = torch.where((torch.arange(len(points)) % 10 == 0)[:, None], normals, torch.zeros_like(normals))
    assert int(unknown.any(1).sum()) == 150
    assert ground(people, normals=unknown) is None
    assert ground(people, points=points[:0], normals=normals[:0]) is None
    points, normals = room(tables=0)  # a wall alone does not say how it is turned
    assert ground(people, points=points, normals=normals) is None
    monkeypatch.setattr(floor_below_people, "MIN_UP_CONFIDENCE", 1.0)
    assert ground(people) is None


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
