"""Settings that change what counts as evidence: whose mask, which keypoints, which contacts, how each is weighed."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from physic_core.engine.joint import terms
from physic_core.engine.joint.context import STATIC_CONTACTS
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.limbs import keypoint_weights
from physic_core.engine.joint.solve import optimize
from physic_core.engine.presets import PRESETS
from physic_core.geometry.robust import absolute, robust
from physic_core.geometry.visibility import near_mask

JOINT = PRESETS["default"].joint


@pytest.fixture(scope="module")
def standing(make_stage):
    return make_stage([({}, (0.0, 0.0, 3.5))])


@pytest.fixture(scope="module")
def behind(make_stage):
    """The second person stands half behind the first."""
    return make_stage([({}, (-0.06, 0.0, 3.0)), ({}, (0.06, 0.0, 3.8))])


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 9))
def test_near_mask_equals_its_slow_twin(seed, reach):
    rng = np.random.default_rng(seed)
    mask = rng.random((17, 23)) < 0.02
    uv = rng.uniform(-30, 50, (12, 2))
    got = near_mask(torch.from_numpy(uv), torch.from_numpy(mask), reach)
    rows, columns = mask.nonzero()
    for (u, v), near in zip(uv.round(), got.tolist(), strict=True):
        assert near == bool(((abs(columns - u) <= reach) & (abs(rows - v) <= reach)).any())


def test_confidence_counts_by_its_power(standing):
    confidence = torch.full_like(standing.problem.keypoint_confidence, 0.6)
    problem = replace(standing.problem, keypoint_confidence=confidence)
    once = JointEnergy(problem, JOINT).fixed.keypoint_weight
    twice = JointEnergy(problem, replace(JOINT, confidence_power=2.0)).fixed.keypoint_weight
    torch.testing.assert_close(twice, 0.6 * once)
    assert sum(weight < 1 for weight in keypoint_weights("blazepose33", 33)) == 2  # hips lie on the skin


def test_static_contacts_need_no_prior(standing):
    nobody = replace(standing.problem, contact_probability=0 * standing.problem.contact_probability)
    bare = replace(JOINT, contact_static_weight=0.0)
    none, static = (JointEnergy(nobody, replace(bare, contact_source=s)).fixed for s in ("prior", "static"))
    assert (none.prior == 0).all()
    model = nobody.model
    wanted = torch.zeros(model.num_vertices, dtype=torch.bool)
    for name in STATIC_CONTACTS:
        wanted[model.contact_sets[name]] = True
    assert len(STATIC_CONTACTS) == 7
    assert torch.equal(static.prior[0] > 0, wanted[static.ids])
    result = optimize(nobody, replace(JOINT, contact_source="static", steps=10))
    assert result.failures == ("",)


def test_the_union_of_masks_takes_who_is_hidden_for_visible(behind):
    own, union = (JointEnergy(behind.problem, replace(JOINT, visibility=v)).visible for v in ("own", "released"))
    assert union.in_mask[1].float().mean() > own.in_mask[1].float().mean() + 0.1


def test_all_limbs_count_as_shown_where_nobody_asks(standing):
    unseen = replace(standing.problem, observed=torch.zeros_like(standing.problem.observed))
    asked, not_asked = (JointEnergy(unseen, replace(JOINT, observed=o)) for o in (True, False))
    assert not asked.visible.in_play.any()
    assert torch.equal(not_asked.visible.in_play, JointEnergy(standing.problem, JOINT).visible.in_play)
    assert torch.equal(not_asked.fixed.keypoint_weight, JointEnergy(standing.problem, JOINT).fixed.keypoint_weight)


def test_contact_by_angle_side_and_mean(standing):
    low = replace(standing.problem, transl0=standing.problem.transl0 + torch.tensor([0.0, 0.01, 0.0]))
    base = replace(JOINT, contact_facing=False)
    plain = JointEnergy(low, base).touch.contact_weight
    steep = JointEnergy(low, replace(base, contact_angle_deg=30.0)).touch
    normals = JointEnergy(low, base).visible.normals
    square = (normals @ low.floor_normal).abs() >= np.cos(np.radians(30.0))
    assert torch.equal(steep.contact_weight > 0, (plain > 0) & square)
    above = JointEnergy(low, replace(base, contact_outside=True))
    height = low.floor_offset - above._gathered[:, above.fixed.ids, 1]
    assert (height[above.touch.contact_weight > 0] > 0).all()
    assert (plain[height <= 0] > 0).any()
    mean = JointEnergy(low, replace(base, contact_mean=True)).touch.contact_weight
    torch.testing.assert_close(mean.sum(1), torch.ones(1))
    torch.testing.assert_close(mean, plain / plain.sum())


def test_contact_vertices_may_penetrate_where_they_are_spared(make_stage):
    stage = make_stage([({}, (0.0, 0.0, 3.5))], boxes=[((-0.5, 1.0, 3.0), (0.5, 1.3, 4.0))], stands_at=1.02)
    spared = JointEnergy(stage.problem, replace(JOINT, penetration_spares_contact=True))
    plain = JointEnergy(stage.problem, JOINT)
    contact = plain.fixed.prior > 0
    assert (plain.touch.penetration_weight[contact] > 0).any()
    assert (spared.touch.penetration_weight[contact] == 0).all()
    assert torch.equal(spared.touch.penetration_weight[~contact], plain.touch.penetration_weight[~contact])


def test_what_only_the_own_body_hides_penetrates_where_that_is_wanted(make_stage):
    crossed = {"left_shoulder": (0.0, -1.3, -0.6), "left_elbow": (0.0, -1.6, 0.0)}
    stage = make_stage([(crossed, (0.0, 0.0, 3.0))], boxes=[((-0.6, -0.4, 3.08), (0.6, 1.3, 3.3))])
    aware = JointEnergy(stage.problem, JOINT)
    both = JointEnergy(stage.problem, replace(JOINT, penetration_self_occluded=True))
    more = (both.touch.penetration_weight > 0) & ~(aware.touch.penetration_weight > 0)
    assert more.any()
    assert (both.visible.hidden & both.visible.in_mask)[more].all()
    assert not ((aware.touch.penetration_weight > 0) & ~(both.touch.penetration_weight > 0)).any()


def test_reprojection_in_pixels_of_a_full_hd_picture(standing):
    energy = JointEnergy(standing.problem, replace(JOINT, reprojection_unit="full_hd", reprojection_sigma=1.0))
    torch.testing.assert_close(energy.fixed.unit, torch.tensor([[320 / 1920]]))


def test_reprojection_per_axis_by_hand_and_its_gradient():
    projected = torch.tensor([[[13.0, 14.0]]], dtype=torch.float64, requires_grad=True)
    observed, one = torch.tensor([[[10.0, 10.0]]], dtype=torch.float64), torch.ones(1, 1, dtype=torch.float64)
    rho = partial(robust, "absolute", c=1.0)
    assert terms.reprojection(projected, observed, one, one, rho, per_axis=True).item() == pytest.approx(3 + 4)
    assert terms.reprojection(projected, observed, one, one, rho).item() == pytest.approx(5)
    for per_axis in (False, True):
        function = partial(terms.reprojection, observed=observed, weight=one, unit=one, rho=rho, per_axis=per_axis)
        assert torch.autograd.gradcheck(function, projected)


def test_the_absolute_loss_is_the_residual_with_no_slope_at_zero():
    x = torch.tensor([-3.0, 0.0, 2.0], requires_grad=True)
    value = absolute(x.square())
    value.sum().backward()
    assert value.tolist() == pytest.approx([3, 0, 2])
    assert x.grad.tolist() == pytest.approx([-1, 0, 1])


@pytest.mark.parametrize("preset", ["release", "prox"])
def test_other_energies_than_ours_go_down(standing, preset):
    joint = PRESETS[preset].joint
    start = replace(standing.problem, transl0=standing.problem.transl0 + torch.tensor([0.0, -0.05, 0.1]))
    result = optimize(start, replace(joint, steps=24, refresh_steps=8))
    begin, end = (sum(pair[k] for pair in result.losses.values()) for k in (0, 1))
    print({name: [round(v, 2) for v in pair] for name, pair in result.losses.items()})
    assert end < 0.7 * begin
    assert result.failures == ("",)
