"""Actions: all names perform, people keep joint limits, touch what they rest on, and are the same for the same seed."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
import roma
import torch

from physic_core.engine.distances import hinge_angles
from physic_testing.worlds.action_scenes import ActionScene, draw_action
from physic_testing.worlds.contact_actions import CONTACT_ACTIONS
from physic_testing.worlds.contact_fit import pose_body
from physic_testing.worlds.furniture import move_blocks
from physic_testing.worlds.pose_builder import PoseBuilder
from physic_testing.worlds.skin_patches import contact_skin
from physic_testing.worlds.solids import LEVEL_GROUND, signed_distance
from physic_testing.worlds.solo_actions import SOLO_ACTIONS, draw_person, move_plan

from .float64_model import float64_model

pytestmark = pytest.mark.kernels


@lru_cache(maxsize=8)
def _performed(name: str, seed: int) -> ActionScene:
    return draw_action(name, float64_model(), np.random.default_rng(seed))


@pytest.mark.parametrize("name", ["stand", "lie", "sit_on_chair", "slope"])
def test_people_touch_and_enter_nothing(name: str) -> None:
    action_scene = _performed(name, 0)
    skin = contact_skin(float64_model())
    for actor in action_scene.actors:
        vertices, _ = pose_body(float64_model(), actor.pose, actor.betas, actor.transl)
        distance = signed_distance(vertices[skin.outer], action_scene.blocks, action_scene.ground)
        assert -distance.min() <= actor.residual + 1e-9
        assert actor.residual < 0.015
        assert -distance.min() < 0.008
        assert (distance <= 0.02).sum() > 200
        hinges = hinge_angles(roma.rotvec_to_rotmat(torch.as_tensor(actor.pose)[None]))
        assert hinges.min() > -0.12
        assert hinges.max() < 2.8


@pytest.mark.parametrize("name", [*SOLO_ACTIONS, *CONTACT_ACTIONS])
def test_plans_bend_joints_only_as_joints_bend(name: str) -> None:
    draw, widest = (SOLO_ACTIONS[name], 2.7) if name in SOLO_ACTIONS else (CONTACT_ACTIONS[name], 2.75)
    patches = contact_skin(float64_model()).patches
    for seed in range(6):
        rng = np.random.default_rng(seed)
        plan = draw(draw_person(float64_model(), rng), rng)
        assert plan.action == name
        assert np.isfinite(plan.pose).all()
        hinges = hinge_angles(roma.rotvec_to_rotmat(torch.as_tensor(plan.pose)[None]))
        assert hinges.min() > -0.05, seed
        assert hinges.max() < widest, seed
        assert 0.05 < plan.pelvis[1] < 1.6
        assert all(touch.patch in patches and (not touch.target or touch.target in patches) for touch in plan.touches)
        assert all(i < len(plan.blocks) for touch in plan.touches for i in touch.blocks or ())


def test_turning_a_plan_turns_all_of_it() -> None:
    rng = np.random.default_rng(1)
    plan = SOLO_ACTIONS["lean_on_table"](draw_person(float64_model(), rng), rng)
    carried = move_plan(plan, (1.0, -0.5), np.pi / 2, 0.2)
    x, y, z = plan.reaches[0].point
    assert carried.reaches[0].point == pytest.approx((z + 1.0, y + 0.2, -x - 0.5))
    vertices, joints = pose_body(float64_model(), plan.pose, plan.betas, np.zeros(3))
    there, where = pose_body(float64_model(), carried.pose, carried.betas, np.zeros(3))
    here, there = vertices - joints[0] + plan.pelvis, there - where[0] + carried.pelvis
    assert there[:, 0] == pytest.approx(here[:, 2] + 1.0, abs=1e-9)
    assert there[:, 2] == pytest.approx(-here[:, 0] - 0.5, abs=1e-9)
    before = signed_distance(here[::20], plan.blocks, LEVEL_GROUND)
    after = signed_distance(
        there[::20] - np.array([0.0, 0.2, 0.0]), move_blocks(carried.blocks, (0.0, 0.0), 0.0, -0.2), LEVEL_GROUND
    )
    assert after == pytest.approx(before, abs=1e-9)


def test_limbs_point_in_the_given_directions() -> None:
    posture = PoseBuilder((20, 0, 0)).trunk(15, 10, 5)
    posture.arm("left", (0.2, -1, 0.3), (0.1, 0.2, 1)).arm("right", (0.2, -1, 0.3), (0.1, 0.2, 1))
    posture.leg("left", 90, 80).foot("left")
    _, joints = pose_body(float64_model(), posture.pose, np.zeros(float64_model().num_betas), np.zeros(3))
    at = dict(zip(float64_model().joint_names, joints, strict=True))

    def direction(start: str, end: str) -> list[float]:
        apart = at[end] - at[start]
        return list(apart / np.linalg.norm(apart))

    upper, fore = np.array([0.2, -1, 0.3]), np.array([0.1, 0.2, 1])
    upper, fore = upper / np.linalg.norm(upper), fore / np.linalg.norm(fore)
    assert direction("left_shoulder", "left_elbow") == pytest.approx(upper, abs=0.02)
    assert direction("right_shoulder", "right_elbow") == pytest.approx(upper * [-1, 1, 1], abs=0.02)
    assert direction("left_elbow", "left_wrist") == pytest.approx(fore, abs=0.02)
    assert direction("left_hip", "left_knee")[2] == pytest.approx(1, abs=0.01)
    assert direction("left_ankle", "left_foot")[2] == pytest.approx(0.94, abs=0.02)
