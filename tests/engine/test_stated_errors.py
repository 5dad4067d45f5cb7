"""How far stage 3 bends and tips bodies whose estimator states its errors."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from scipy.spatial.transform import Rotation

from physic_core import engine_preset
from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.joint.solve import optimize
from physic_core.geometry.rotvecs import rotvec_to_rotmat

from .adjusted import adjusted, posed

SETTINGS = engine_preset("default").joint
SHORT = adjusted(SETTINGS, optimiser__steps=5)
ELBOW = JOINT_INDEX["left_elbow"]
BENT = 0.3  # radians that the start has the elbow off


@pytest.fixture(scope="module")
def bent(standing):
    """A person whose left elbow is bent at the start, and straight in the photo."""
    turns = torch.zeros(55, 3)
    turns[ELBOW, 1] = BENT
    rotations = standing.state.rotations @ rotvec_to_rotmat(turns)
    return replace(standing.state, rotations=rotations)


def stated(sigma):
    """(1, 22) radians, stated of the left elbow alone."""
    sigmas = torch.full((1, 22), torch.nan)
    sigmas[:, ELBOW] = sigma
    return sigmas


def turned(state):
    """Radians by which stage 3 turns the left elbow."""
    end = optimize(state, SETTINGS).rotations[0, ELBOW]
    before = state.rotations[0, ELBOW].to(end)
    return Rotation.from_matrix(before.T @ end).magnitude()


def test_the_smaller_its_stated_error_the_less_a_joint_turns(bent):
    sure, unsure = (turned(replace(bent, rotation_sigma=stated(s))) for s in (0.02, 1.0))
    assert sure < 0.1 * BENT
    assert unsure > 0.5 * BENT


def test_unknown_errors_and_those_of_limbs_that_the_photo_does_not_show_count_nothing(bent):
    observed = bent.observed.clone()
    moved = [
        JOINT_INDEX["left_wrist"],
        *range(JOINT_INDEX["left_index1"], JOINT_INDEX["right_index1"]),
    ]
    observed[:, moved] = False
    hidden = replace(bent, observed=observed)
    for state, sigma in ((hidden, 0.02), (bent, torch.nan)):
        plain, told = (
            optimize(replace(state, rotation_sigma=s), SHORT) for s in (None, stated(sigma))
        )
        assert torch.equal(plain.rotations, told.rotations)


def standing_feet(stands):
    """Probability that the feet of one person stand, whose left one does with a probability."""
    return torch.tensor([[stands, 0.0]])


@pytest.fixture(scope="module")
def short_legged(standing):
    """A person who stands, and whose ankles the photo shows 2 % of the stature too high."""
    state = standing.state
    ends = ("ankle", "heel", "foot_tip")
    feet = [i for i, name in enumerate(state.skeleton.names) if name.endswith(ends)]
    keypoints = state.keypoints.clone()
    keypoints[:, feet, 1] -= 0.02 * 1.7 / 3.5 * state.K[1, 1]
    return replace(state, keypoints=keypoints, stand_probability=standing_feet(1.0))


def lean(state):
    """Radians by which stage 3 tips the line from ankles to neck, seen from the side."""

    def angle(joints):
        ankles = [JOINT_INDEX["left_ankle"], JOINT_INDEX["right_ankle"]]
        column = joints[JOINT_INDEX["neck"]] - joints[ankles].mean(0)
        return torch.atan2(column[2], -column[1])

    start = posed(state)
    return float((angle(optimize(state, SETTINGS).joints[0]) - angle(start.joints[0])).abs())


def test_a_stated_lean_is_kept_where_legs_seem_too_long_and_less_over_an_unsure_floor(short_legged):
    sure = replace(short_legged, lean_sigma=torch.tensor([0.01]))
    tilted = replace(sure.scene.floor, pitch_sigma=0.3)
    unsure = replace(sure, scene=replace(sure.scene, floor=tilted))
    kept, less, free = (lean(state) for state in (sure, unsure, short_legged))
    assert kept < less < free
    assert kept < 0.5 * free


@pytest.mark.parametrize(("stands", "sigma"), [(0.0, 0.01), (1.0, torch.nan)])
def test_the_lean_of_people_who_do_not_stand_or_were_not_set_upright_is_free(
    short_legged, stands, sigma
):
    plain = replace(short_legged, stand_probability=standing_feet(stands))
    told = replace(plain, lean_sigma=torch.tensor([sigma]))
    assert torch.equal(optimize(plain, SHORT).joints, optimize(told, SHORT).joints)
