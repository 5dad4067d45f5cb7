"""The state starts at the start, moves what is free, and can be put back."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.testing import assert_close

from physic_core.engine.joint.variables import PARAMETER_GROUPS, Variables
from physic_core.geometry.rotvecs import rotvec_to_rotmat
from physic_paper.published import UnwhitenedVariables

from .drawn import normal

pytestmark = pytest.mark.quick

K = 4
KINDS = [Variables, UnwhitenedVariables]


def start(people=2, seed=0):
    rotations = rotvec_to_rotmat(normal(people, 55, 3, seed=seed))
    betas = normal(people, K, seed=seed)
    transl = normal(people, 3, seed=seed) + torch.tensor([0.0, 0.0, 5.0])
    pelvis = transl + torch.tensor([0.0, -0.3, 0.01])
    return rotations, betas, transl, pelvis


@pytest.mark.parametrize("kind", KINDS)
def test_unpacks_to_where_it_starts(kind):
    rotations, betas, transl, pelvis = start()
    estimate = kind(rotations, betas, transl, pelvis).unpack()
    assert_close(estimate.rotations, rotations)
    assert_close(estimate.betas, betas)
    assert_close(estimate.transl, transl)
    assert estimate.log_scale.item() == 0
    assert estimate.offset.tolist() == [0, 0]


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000))
def test_rotations_stay_rotations_and_packing_round_trips(kind, seed):
    variables = kind(*start(seed=seed))
    moved = variables.pack() + 0.3 * normal(len(variables.pack()), seed=seed)
    variables.load(moved)
    assert_close(variables.pack(), moved)
    rotations = variables.unpack().rotations
    eye = torch.eye(3, dtype=torch.float64).expand_as(rotations)
    assert_close(rotations @ rotations.mT, eye)
    assert_close(torch.linalg.det(rotations), torch.ones(2, 55).double())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("group", PARAMETER_GROUPS)
def test_a_frozen_group_has_no_gradient_and_the_others_do(kind, group):
    variables = kind(*start(), frozen=[group])
    assert group not in variables.free
    estimate = variables.unpack()
    of_rotations = (estimate.rotations * normal(2, 55, 3, 3)).sum()
    squares = (estimate.transl**2).sum() + (estimate.betas**2).sum()
    (of_rotations + squares + estimate.log_scale + estimate.offset.sum()).backward()
    for name in PARAMETER_GROUPS:
        assert (variables.values[name].grad is None) == (name == group)
