"""Hands put onto arms: where they agree nothing happens, on the way nothing jumps, and the wrist
stays where it is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from physic_core.body import JOINT_INDEX, load_body
from physic_core.body.attach_hands import WRIST_LIMITS, attach_hands
from physic_core.body.bones import (
    parameters_from_rotations,
    pose_from_parameters,
    rotations_from_parameters,
    rotations_from_parents,
    rotations_from_tpose,
)
from physic_core.geometry.rotations import rotmat_to_rotvec, rotvec_to_rotmat_numpy
from physic_core.types import Hands

MODEL = load_body("embedded")
ELBOWS = [18, 19]
WRISTS = [20, 21]
"""Of the embedded body's forearms."""


def body(seed=0):
    rng = np.random.default_rng(seed)
    rotvecs = 0.4 * rng.standard_normal((1, 55, 3))
    rotvecs[:, WRISTS] *= 0.3
    shape = rng.standard_normal((1, MODEL.num_betas))
    place = rng.standard_normal((1, 3))
    betas, transl = (torch.from_numpy(value) for value in (shape, place))
    return parameters_from_rotations(
        torch.from_numpy(rotvec_to_rotmat_numpy(rotvecs)), betas, None, transl
    )


def posed(parameters):
    """With every fourth vertex of the hands."""
    ids = MODEL.part_mask("hand").nonzero()[::4, 0]
    return MODEL(*pose_from_parameters(parameters), vertex_ids=ids)


def world_of(parameters):
    return rotations_from_tpose(rotations_from_parameters(parameters).double().numpy())


def hands_of(parameters, wrists, confidence):
    """The body's own fingers, on wrists (1, 2, 3) of somebody else."""
    own = np.stack([parameters.left_hand_pose, parameters.right_hand_pose], 1).reshape(1, 2, 15, 3)
    return Hands(own, np.full((1, 2), confidence), wrists)


def attached(parameters, wrists, confidence=1.0):
    return attach_hands(parameters, hands_of(parameters, wrists, confidence), MODEL)


def wrists_of(parameters):
    """Rotation vectors (1, 2, 3) of the wrists."""
    return rotmat_to_rotvec(world_of(parameters)[:, WRISTS])


def test_a_hand_that_agrees_changes_nothing():
    before = body()
    wrists = wrists_of(before)
    after = attached(before, wrists)
    for name, value in vars(before).items():
        assert_allclose(getattr(after, name), value, atol=1e-5)


def test_only_the_arm_of_the_hand_that_was_found_is_touched():
    before = body()
    hands = replace(
        hands_of(before, np.full((1, 2, 3), np.nan), 0.9), confidence=np.array([[0.0, 0.9]])
    )
    hands.wrists[:, 1] = [0.1, 0.2, 0.3]
    after = attach_hands(before, hands, MODEL)
    changed = np.flatnonzero((before.body_pose != after.body_pose).reshape(21, 3).any(1)) + 1
    assert set() < set(changed) <= {JOINT_INDEX["right_elbow"], JOINT_INDEX["right_wrist"]}
    assert_array_equal(before.left_hand_pose, after.left_hand_pose)


def test_fingers_of_a_half_sure_hand_bend_half_as_far():
    flat = dict.fromkeys(("left_hand_pose", "right_hand_pose"), np.zeros((1, 45), np.float32))
    before = replace(body(), **flat)
    hands = hands_of(before, wrists_of(before), 0.3)
    after = attach_hands(before, replace(hands, rotvecs=np.full((1, 2, 15, 3), 0.3)), MODEL)
    assert_allclose(after.right_hand_pose, np.full((1, 45), 0.15), atol=1e-5)


@pytest.mark.parametrize("side", [0, 1], ids=["left", "right"])
def test_a_hand_that_a_wrist_can_reach_is_reached(side):
    """Known answer: bent up by 40 and turned over by 50 degrees."""
    before = body(3)
    over, up = rotvec_to_rotmat_numpy(np.radians([[50.0, 0, 0], [0, 0, 40.0]]))
    wanted = world_of(before)[:, ELBOWS[side]] @ over @ up
    wrists = wrists_of(before)
    wrists[:, side] = rotmat_to_rotvec(wanted)
    after = attached(before, wrists)
    reached = world_of(after)[:, WRISTS[side]]
    assert_allclose(reached, wanted, atol=2e-6)
    other = WRISTS[1 - side]
    assert_allclose(world_of(after)[:, other], world_of(before)[:, other], atol=2e-6)


ROTVEC = arrays(np.float64, (1, 2, 3), elements=st.floats(-2.0, 2.0, width=32))


@settings(max_examples=4)
@given(ROTVEC, st.integers(0, 50))
def test_nothing_jumps_on_the_way_and_the_wrist_stays(wrists, seed):
    before = body(seed)
    start = posed(before)
    steps = np.linspace(0, 1, 41)
    flat = Rotation.from_rotvec(rotmat_to_rotvec(world_of(before)[0, WRISTS]))
    turn = (Rotation.from_rotvec(wrists[0]) * flat.inv()).magnitude().max()
    last = start.vertices
    for confidence in steps[1:]:
        after = posed(attached(before, wrists, float(confidence)))
        # Elbows and wrists do not move at all.
        arms = [*ELBOWS, *WRISTS]
        assert (after.joints[:, arms] - start.joints[:, arms]).norm(dim=-1).max() < 1e-5
        # A hand is 0.22 m long; the steepest of the smooth ramp is 1.5 / 0.4 of the way a unit of
        # confidence.
        moved = float((after.vertices - last).norm(dim=-1).max())
        assert moved < 0.26 * turn * 1.5 / 0.4 / 40 * 1.3 + 1e-4
        last = after.vertices


@settings(max_examples=25)
@given(ROTVEC, st.integers(0, 50))
def test_a_wrist_stays_in_its_range(wrists, seed):
    before = body(seed)
    after = attached(before, wrists)
    first, last = (
        rotmat_to_rotvec(rotations_from_parents(world_of(p))[:, WRISTS]) for p in (before, after)
    )
    limits = WRIST_LIMITS + 0.01
    assert (last >= np.minimum(-limits, first) - 1e-5).all()
    assert (last <= np.maximum(limits, first) + 1e-5).all()
