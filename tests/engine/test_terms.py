"""Values of terms that are worked out by hand."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.testing import assert_close

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.joint.sampling import root_relative
from physic_core.engine.joint.terms.priors import hinge_angles, limit_energy
from physic_core.engine.joint.terms.scene_contact import lowest_height
from physic_core.geometry.rotvecs import rotvec_to_rotmat
from physic_paper.terms.point_penetration import point_penetration_energy

from .drawn import normal

pytestmark = pytest.mark.quick


def test_penetration_as_printed_counts_only_what_is_behind_the_normal():
    value = point_penetration_energy(
        torch.tensor([[4.0, 4.0]]), torch.tensor([[-0.1, 0.1]]), torch.ones(1, 2)
    )
    assert value.item() == 4.0


def test_a_flat_sole_is_as_high_as_it_is_and_a_tiptoe_as_its_toes():
    assert lowest_height(torch.full((1, 50), 0.07)).item() == pytest.approx(0.07)
    tiptoe = torch.cat([torch.zeros(1, 10), torch.full((1, 90), 0.08)], 1)
    assert lowest_height(tiptoe).item() == 0


def turned(**joints):
    x = torch.zeros(1, 55, 3, dtype=torch.float64)
    for name, turn in joints.items():
        x[0, JOINT_INDEX[name]] = torch.tensor(turn, dtype=torch.float64)
    return rotvec_to_rotmat(x)


def test_hinges_measure_flexion_whatever_the_twist():
    bent = turned(
        left_knee=(1.0, 0, 0),
        right_knee=(0.5, 0, 0),
        left_elbow=(0, -1.2, 0),
        right_elbow=(0, 0.7, 0),
    )
    assert hinge_angles(bent)[0].tolist() == pytest.approx([1.0, 0.5, 1.2, 0.7])
    twist = turned(left_knee=(0, 0.6, 0), right_elbow=(0.8, 0, 0))
    assert hinge_angles(bent @ twist)[0].tolist() == pytest.approx([1.0, 0.5, 1.2, 0.7])


def test_limits_are_one_sided():
    assert limit_energy(turned(left_knee=(2.0, 0, 0), left_elbow=(0, -2.0, 0))).item() == 0
    assert limit_energy(turned(left_knee=(-0.25, 0, 0))).item() == pytest.approx(9.0)
    assert limit_energy(turned(right_elbow=(0, -0.25, 0))).item() == pytest.approx(9.0)
    assert limit_energy(turned(left_knee=(2.95, 0, 0))).item() == pytest.approx(9.0)


def test_knees_and_elbows_bend_as_the_body_does(body):
    """A positive knee angle brings the foot back, a positive elbow angle brings the hand
    forward.
    """
    rest = body(*body.zero_pose(1)).joints[0]
    rotations = turned(
        left_knee=(0.5, 0, 0), right_elbow=(0, 0.5, 0), left_elbow=(0, -0.5, 0)
    ).float()
    assert (hinge_angles(rotations)[0, [0, 2, 3]] > 0).all()
    moved = body(rotations, *body.zero_pose(1)[1:]).joints[0] - rest
    assert moved[JOINT_INDEX["left_ankle"], 2] < -0.1
    assert moved[JOINT_INDEX["left_wrist"], 2] > 0.1
    assert moved[JOINT_INDEX["right_wrist"], 2] > 0.1


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31 - 1))
def test_regularisation_does_not_see_where_a_body_is_and_how_it_is_turned(seed):
    vertices = normal(2, 6, 3, seed=seed)
    pelvis = normal(2, 3, seed=seed + 1)
    root = rotvec_to_rotmat(3 * normal(2, 3, seed=seed + 2))
    turn = rotvec_to_rotmat(3 * normal(3, seed=seed + 3))
    move = normal(3, seed=seed + 4)
    here = root_relative(vertices, pelvis, root)
    there = root_relative(vertices @ turn.T + move, pelvis @ turn.T + move, turn @ root)
    assert_close(here, there)
