"""People who sit rest on their seat, near or far, seen or hidden."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import pytest
import torch

from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.limbs import is_sitting
from physic_core.engine.joint.solve import optimize
from physic_core.engine.joint.terms.seat import seat_energy
from physic_core.engine.presets import PRESETS
from physic_core.geometry.robust import cauchy

SITS = {
    "left_hip": (-1.45, 0, 0),
    "right_hip": (-1.45, 0, 0),
    "left_knee": (1.45, 0, 0),
    "right_knee": (1.45, 0, 0),
}
LUNGES = {"left_hip": (-1.5, 0, 0), "left_knee": (1.5, 0, 0), "right_knee": (0.6, 0, 0)}
UP = torch.tensor([0.0, -1.0, 0.0])
SETTINGS = PRESETS["default"].joint


def bends_over(stage_of):
    """Legs straight, the trunk level: the root turns forward, the hips turn back."""
    return stage_of([({"pelvis": (1.4, 0, 0), "left_hip": (-1.4, 0, 0), "right_hip": (-1.4, 0, 0)}, (0, 0, 3.0))])


@pytest.fixture(scope="module")
def seated(make_stage):
    """Somebody on a box of 45 cm, feet on the floor; the box is seen on both sides of them."""
    stage = make_stage([(SITS, (0.0, 0.0, 3.0))])
    bottom = float(stage.vertices[0, stage.problem.model.contact_sets["gluteus"], 1].amax())
    pelvis = stage.joints[0, 0]
    box = ([-0.6, bottom, float(pelvis[2]) - 0.35], [0.6, 1.3, float(pelvis[2]) + 0.25])
    return make_stage([(SITS, (0.0, 0.0, 3.0))], [box])


def test_gradient_of_seat():
    gap = torch.tensor([0.3, -0.1, 0.02], dtype=torch.float64, requires_grad=True)
    weight = torch.tensor([2.0, 1.0, 0.0], dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda g: seat_energy(g, weight, partial(cauchy, c=0.06)), gap)
    # 2 cm away with a loss that is quadratic near zero: twice 0.02^2.
    assert seat_energy(torch.tensor([0.02]), torch.tensor([2.0]), lambda q: q).item() == pytest.approx(8e-4)


def test_gradient_of_the_term_by_pose_scale_and_local_scale(seated):
    problem = replace(seated.problem, model=seated.problem.model.to(dtype=torch.float64)).to_model_dtype()
    problem = replace(problem, transl0=problem.transl0 + torch.tensor([0.0, -0.2, 0.0]).double())
    energy = JointEnergy(problem, SETTINGS)
    assert energy.weights["seat"].tolist() == [1.0]
    state = energy.state
    start = state.pack()
    index = torch.arange(0, len(start), max(1, len(start) // 40))

    def value() -> torch.Tensor:
        return energy()["seat"].sum()

    gradients = torch.autograd.grad(value(), state.parameters(), allow_unused=True)
    flat = torch.cat(
        [
            (torch.zeros_like(p) if g is None else g).reshape(-1)
            for p, g in zip(state.parameters(), gradients, strict=True)
        ]
    )
    step = 1e-6
    for i in index.tolist():
        ends = []
        for sign in (1, -1):
            moved = start.clone()
            moved[i] += sign * step
            state.load(moved)
            ends.append(float(value().detach()))
        assert (ends[0] - ends[1]) / (2 * step) == pytest.approx(float(flat[i]), rel=1e-4, abs=1e-5)
    state.load(start)


def test_who_sits_and_who_does_not(make_stage):
    stages = [*(make_stage([(bends, (0, 0, 3.0))]) for bends in ({}, SITS, LUNGES)), bends_over(make_stage)]
    assert [bool(is_sitting(s.problem.rotations0, s.joints, UP)) for s in stages] == [False, True, False, False]


def test_a_seat_beyond_the_reach_of_contact_is_found(seated):
    problem = replace(
        seated.problem,
        transl0=seated.problem.transl0 + torch.tensor([0.0, -0.25, 0.0]),
        keypoint_confidence=torch.zeros_like(seated.problem.keypoint_confidence),
        human_depth=None,
        floor_normal=None,
    )
    settings = replace(SETTINGS.without("depth"), frozen=("scale",))
    without = replace(settings, contact=replace(settings.contact, seat_weight=0.0))
    gluteus = problem.model.contact_sets["gluteus"]
    bottom = float(seated.vertices[0, gluteus, 1].amax())

    def gap(used):
        return bottom - float(optimize(problem, used).vertices[0, gluteus, 1].amax())

    print(f"{100 * gap(without):.1f} cm over the seat without the term, {100 * gap(settings):.1f} cm with it")
    assert abs(gap(settings)) < 0.05 < gap(without)
