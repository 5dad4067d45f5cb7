"""How far stage 3 bends bodies whose estimator states its errors."""

from __future__ import annotations

from dataclasses import replace

import pytest
import roma
import torch

from physic_core import engine_preset
from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.joint.solve import optimize

from .adjusted import adjusted

SETTINGS = engine_preset("default").joint
ELBOW = JOINT_INDEX["left_elbow"]
BENT = 0.3  # radians that the start has the elbow off


@pytest.fixture(scope="module")
def bent(make_stage):
    """A person whose left elbow is bent at the start, and straight in the photo."""
    state = make_stage([({}, (0.0, 0.0, 3.5))]).state
    rotations = state.rotations.clone()
    rotations[:, ELBOW] = rotations[:, ELBOW] @ roma.rotvec_to_rotmat(
        torch.tensor([0.0, BENT, 0.0])
    )
    return replace(state, rotations=rotations)


def stated(sigma):
    """(1, 22) radians, stated of the left elbow alone."""
    sigmas = torch.full((1, 22), torch.nan)
    sigmas[:, ELBOW] = sigma
    return sigmas


def turned(state):
    """Radians by which stage 3 turns the left elbow."""
    end = optimize(state, SETTINGS).rotations[0, ELBOW]
    return float(roma.rotmat_geodesic_distance(end, state.rotations[0, ELBOW].to(end)))


def test_the_smaller_its_stated_error_the_less_a_joint_turns(bent):
    turns = [turned(replace(bent, rotation_sigma=stated(sigma))) for sigma in (0.02, 0.2, 1.0)]
    assert turns == sorted(turns)
    assert turns[0] < 0.1 * BENT
    assert turns[2] > 0.5 * BENT


def test_a_limb_that_the_photo_does_not_show_turns_as_without_a_stated_error(bent):
    observed = bent.observed.clone()
    moved = [
        JOINT_INDEX["left_wrist"],
        *range(JOINT_INDEX["left_index1"], JOINT_INDEX["right_index1"]),
    ]
    observed[:, moved] = False
    hidden = replace(bent, observed=observed)
    plain, sure = (
        optimize(replace(hidden, rotation_sigma=s), SETTINGS) for s in (None, stated(0.02))
    )
    assert torch.equal(plain.rotations, sure.rotations)


def test_an_unknown_error_is_none_stated(bent):
    plain, unknown = (
        optimize(replace(bent, rotation_sigma=s), SETTINGS) for s in (None, stated(torch.nan))
    )
    assert torch.equal(plain.rotations, unknown.rotations)


@pytest.mark.parametrize("preset", ["paper", "release", "prox"])
def test_energies_of_the_paper_do_not_ask_for_stated_errors(bent, preset):
    short = adjusted(engine_preset(preset).joint, optimiser__steps=2)
    plain, sure = (optimize(replace(bent, rotation_sigma=s), short) for s in (None, stated(0.02)))
    assert torch.equal(plain.rotations, sure.rotations)
