"""Bodies as capsules: exact distances, the own body's fit, and limbs and people that come out of each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import minimize

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.joint.capsules import SEGMENTS, between_people, fit_capsules, segment_distance, within_bodies
from physic_core.engine.joint.solve import optimize
from physic_core.engine.presets import PRESETS

DEFAULT = PRESETS["default"].joint
CORNERS = arrays(np.float64, (4, 3), elements=st.floats(-2, 2, width=32))


def slow_distance(a, b, c, d):
    """The same by trying: where on both segments, from every corner of the square of positions."""

    def squared(at):
        return float(np.square(a + at[0] * (b - a) - c - at[1] * (d - c)).sum())

    starts = [(i, j) for i in (0.0, 0.5, 1.0) for j in (0.0, 0.5, 1.0)]
    found = [minimize(squared, s, bounds=((0, 1), (0, 1)), tol=1e-14).fun for s in starts]
    return np.sqrt(min(found))


@settings(max_examples=60, deadline=None)
@given(CORNERS)
def test_segment_distance_equals_its_slow_twin(ends):
    got = segment_distance(*torch.from_numpy(ends)).item()
    assert got == pytest.approx(max(slow_distance(*ends), 1e-4), abs=1e-5)


@settings(max_examples=60, deadline=None)
@given(CORNERS, st.floats(0, 1), st.floats(0, 1))
def test_no_two_points_of_segments_are_nearer(ends, s, t):
    a, b, c, d = ends
    here = np.linalg.norm(a + s * (b - a) - c - t * (d - c))
    assert segment_distance(*torch.from_numpy(ends)).item() <= here + 1e-4


def test_segment_distance_by_hand():
    def at(*corners):
        return segment_distance(*torch.tensor(corners, dtype=torch.float64)).item()

    assert at((0, 0, 0), (2, 0, 0), (1, 1, -1), (1, 1, 1)) == pytest.approx(1)  # across
    assert at((0, 0, 0), (1, 0, 0), (3, 0, 0), (4, 0, 0)) == pytest.approx(2)  # in line
    assert at((0, 0, 0), (1, 0, 0), (0, 3, 0), (1, 3, 0)) == pytest.approx(3)  # side by side
    assert at((0, 0, 0), (0, 0, 0), (0, 4, 0), (0, 4, 0)) == pytest.approx(4)  # points


def test_gradient_of_segment_distance():
    ends = torch.randn(4, 6, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    assert torch.autograd.gradcheck(segment_distance, tuple(e.requires_grad_() for e in ends))
    touching = torch.zeros(1, 3, dtype=torch.float64, requires_grad=True)
    segment_distance(touching, touching + 1, touching, touching + 1).sum().backward()
    assert torch.isfinite(touching.grad).all()


def test_capsules_lie_inside_the_skin(body):
    """No capsule sticks out of the T-pose by much: most of its surface is under the vertices that it stands for."""
    rotations, betas, transl = body.zero_pose(1)
    output = body(rotations, betas, transl)
    capsules = fit_capsules(body, betas, output.joints)
    for k, segment in enumerate(SEGMENTS):
        assert 0.02 < capsules.radius[0, k] < 0.15, segment.name
    left = [capsules.radius[0, k] for k, s in enumerate(SEGMENTS) if s.name.startswith("left")]
    right = [capsules.radius[0, k] for k, s in enumerate(SEGMENTS) if s.name.startswith("right")]
    torch.testing.assert_close(torch.stack(left), torch.stack(right), atol=2e-3, rtol=0)


def test_a_larger_body_has_thicker_capsules(body):
    rotations, betas, transl = body.zero_pose(2)
    betas[1, 0] = 2.0
    capsules = fit_capsules(body, betas, body(rotations, betas, transl).joints)
    assert (capsules.radius[1] > capsules.radius[0]).all()


def capsules_at_rest(body, dtype=torch.float32):
    model = body.to(dtype=dtype)
    rotations, betas, transl = model.zero_pose(1)
    joints = model(rotations, betas, transl).joints
    return model, fit_capsules(model, betas, joints), joints


def test_rest_costs_nothing_and_a_limb_in_the_trunk_does(body):
    _, capsules, joints = capsules_at_rest(body)
    assert within_bodies(joints, capsules, 0.005, 0.01).item() == 0
    wrist = JOINT_INDEX["left_wrist"]
    through = joints.clone()
    through[:, wrist] = joints[:, JOINT_INDEX["spine2"]]
    assert within_bodies(through, capsules, 0.005, 0.01).item() > 10


def test_what_the_start_has_is_allowed(body):
    model, _, joints = capsules_at_rest(body)
    through = joints.clone()
    through[:, JOINT_INDEX["left_wrist"]] = joints[:, JOINT_INDEX["spine2"]]
    capsules = fit_capsules(model, model.zero_pose(1)[1], through)
    assert within_bodies(through, capsules, 0.005, 0.01).item() == 0


def test_gradients_of_overlap(body):
    _, capsules, joints = capsules_at_rest(body, torch.float64)
    noise = 0.1 * torch.randn(2, 55, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    two = replace(capsules, radius=capsules.radius.repeat(2, 1), allowed=0 * capsules.allowed.repeat(2, 1))
    placed = (joints + noise).requires_grad_()
    assert within_bodies(placed, two, 0.0, 0.05).gt(0).all()
    assert torch.autograd.gradcheck(lambda j: within_bodies(j, two, 0.0, 0.05), placed)
    assert torch.autograd.gradcheck(lambda j: between_people(j, two, 0.0, 0.05), placed)


def test_between_people_equals_its_slow_twin(body):
    _, capsules, joints = capsules_at_rest(body, torch.float64)
    places = torch.tensor([[0.0, 0, 0], [0.25, 0, 0.1], [5.0, 0, 0]], dtype=torch.float64)
    crowd = joints + places[:, None]
    three = replace(capsules, radius=capsules.radius.repeat(3, 1), allowed=capsules.allowed.repeat(3, 1))
    want = torch.zeros(3, dtype=torch.float64)
    ends = crowd[:, capsules.joints].mean(3)
    for a in range(3):
        for b in range(3):
            for i in range(len(SEGMENTS)):
                for j in range(len(SEGMENTS)):
                    gap = segment_distance(ends[a, i, 0], ends[a, i, 1], ends[b, j, 0], ends[b, j, 1])
                    deep = (three.radius[a, i] + three.radius[b, j] - gap - 0.02).clamp(min=0) / 0.02
                    want[a] += 0.5 * deep**2 * (a != b)
    got = between_people(crowd, three, 0.02, 0.02)
    torch.testing.assert_close(got, want)
    assert got[2] == 0 < got[0]
    assert between_people(joints, capsules, 0.02, 0.02).item() == 0


def test_two_people_who_were_put_into_one_another_come_apart(make_stage):
    """Placed 25 cm apart, too near for their shoulders; no keypoint and no depth says where they are."""
    problem = make_stage([({}, (-0.125, 0.0, 3.4)), ({}, (0.125, 0.0, 3.4))]).problem
    blind = replace(problem, keypoint_confidence=0 * problem.keypoint_confidence, human_depth=None)
    loose = replace(DEFAULT, depth_weight=0.0, steps=40)
    start = problem.model(problem.rotations0, problem.betas0, problem.transl0).joints
    capsules = fit_capsules(problem.model, problem.betas0, start)

    def depth(result):
        return between_people(result.joints, capsules, 0.02, 0.02).sum().item()

    through, apart = optimize(blind, loose), optimize(blind, replace(loose, people_penetration_weight=1.0))
    print(f"overlap {depth(through):.1f} without the term, {depth(apart):.1f} with it")
    assert depth(through) > 10
    assert depth(apart) < 0.1 * depth(through)
    assert apart.losses["people"][1] < 0.1 * apart.losses["people"][0]


def test_who_penetrates_nowhere_pays_nothing(make_stage):
    stage = make_stage([({}, (0.0, 0.0, 3.4))])
    problem = stage.problem
    through = stage.joints.clone()
    through[:, JOINT_INDEX["left_wrist"]] = stage.joints[:, JOINT_INDEX["spine1"]]
    capsules = fit_capsules(problem.model, problem.betas0, stage.joints)
    assert within_bodies(through, capsules, 0.005, 0.01).item() > 10
    result = optimize(problem, replace(DEFAULT, self_penetration_weight=1.0, steps=10))
    assert result.losses["self"] == (0.0, pytest.approx(0.0, abs=1e-3))
