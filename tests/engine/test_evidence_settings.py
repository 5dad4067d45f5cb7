"""Settings that change what counts as evidence: whose mask, which keypoints, which contacts, how
each is weighed.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.testing import assert_close

from physic_core import engine_preset
from physic_core.engine.joint.energy import JointEnergy
from physic_core.geometry.robust import robust_loss
from physic_paper.released.reprojection import is_near_mask
from physic_paper.terms.reprojection import ReprojectionByAxisTerm, confidence_weights

from .adjusted import term_of

JOINT, PAPER, RELEASE, PROX = (
    engine_preset(name).joint for name in ("default", "paper", "release", "prox")
)


@pytest.fixture(scope="module")
def behind(make_stage):
    """The second person stands half behind the first."""
    return make_stage([({}, (-0.06, 0.0, 3.0)), ({}, (0.06, 0.0, 3.8))])


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 9))
def test_near_mask_equals_its_slow_reference(seed, reach):
    rng = np.random.default_rng(seed)
    mask = rng.random((17, 23)) < 0.02
    uv = rng.uniform(-30, 50, (12, 2))
    got = is_near_mask(torch.from_numpy(uv), torch.from_numpy(mask), reach)
    rows, columns = mask.nonzero()
    for (u, v), near in zip(uv.round(), got.tolist(), strict=True):
        assert near == bool(((abs(columns - u) <= reach) & (abs(rows - v) <= reach)).any())


def test_confidence_counts_by_its_power(standing):
    confidence = torch.full_like(standing.state.keypoint_confidence, 0.6)
    state = replace(standing.state, keypoint_confidence=confidence)
    once, twice = (confidence_weights(state, power=power) for power in (1.0, 2.0))
    assert_close(twice, 0.6 * once)
    assert torch.equal(JointEnergy(state, PROX).sampling.keypoint_weights, twice)
    plain, halved = (
        replace(state.skeleton, weights=weights) for weights in ({}, {"left_hip": 0.5})
    )
    full, half = (
        confidence_weights(replace(state, skeleton=skeleton)) for skeleton in (plain, halved)
    )
    assert_close(
        half, full * full.new_tensor([halved.weights.get(name, 1.0) for name in plain.names])
    )


def test_the_union_of_masks_makes_hidden_people_visible(behind):
    own, union = (
        JointEnergy(behind.state, joint).snapshot.visibility for joint in (PAPER, RELEASE)
    )
    assert union.in_mask[1].float().mean() > own.in_mask[1].float().mean() + 0.1


def test_contact_vertices_may_penetrate_in_the_released_code_alone(make_stage):
    stage = make_stage(
        [({}, (0.0, 0.0, 3.5))], boxes=[((-0.5, 1.0, 3.0), (0.5, 1.3, 4.0))], stands_at=1.02
    )
    spared, plain = (JointEnergy(stage.state, joint) for joint in (RELEASE, PAPER))
    contact = plain.sampling.is_contact
    assert (plain.weights["penetration"][contact] > 0).any()
    assert (spared.weights["penetration"][contact] == 0).all()
    assert (spared.weights["penetration"][~contact] > 0).any()


def test_self_occluded_vertices_penetrate_in_the_released_code_only(make_stage):
    crossed = {"left_shoulder": (0.0, -1.3, -0.6), "left_elbow": (0.0, -1.6, 0.0)}
    stage = make_stage([(crossed, (0.0, 0.0, 3.0))], boxes=[((-0.6, -0.4, 3.08), (0.6, 1.3, 3.3))])
    for joint, wanted in ((PAPER, False), (RELEASE, True)):
        energy = JointEnergy(stage.state, joint)
        own = energy.snapshot.visibility.hidden & energy.snapshot.visibility.in_mask
        assert own.any()
        assert bool((energy.weights["penetration"] > 0)[own].any()) == wanted


def test_reprojection_of_prox_is_by_axis_in_pixels_of_a_full_hd_picture(standing):
    state = standing.state
    off = replace(state, keypoints=state.keypoints + torch.tensor([3.0, 4.0]))
    energy = JointEnergy(off, PROX)
    assert term_of(energy, ReprojectionByAxisTerm)
    robust = partial(robust_loss, "geman_mcclure", c=100.0)
    want = (
        sum(float(robust(torch.tensor(px * 1920 / 320) ** 2)) for px in (3.0, 4.0))
        * energy.sampling.keypoint_weights
    )
    assert energy()["reprojection"].item() == pytest.approx(float(want.sum()), rel=1e-3)
