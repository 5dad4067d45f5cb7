"""Minimising: known minima are reached, no end is worse than its start, and no step goes where there are no numbers."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physic_core.engine.joint.optimiser import LbfgsHistory, LbfgsSettings
from physic_core.engine.joint.state import State
from physic_paper.adam import AdamSettings

LBFGS = LbfgsSettings()
ADAM = AdamSettings(learning_rate=0.1, steps=100, refresh_steps=30)


class Bowl:
    """Pulls the translation to a goal; counts what is asked of it."""

    def __init__(self, goal=(0.3, -0.2, 3.0), wall=None, after_refresh=None):
        eye = torch.eye(3).double().expand(1, 55, 3, 3)
        place = torch.tensor([[0.0, 0.0, 2.0]]).double()
        frozen = ["root", "pose", "hands", "betas", "scale", "offset"]
        self.state = State(eye, torch.zeros(1, 2).double(), place, place, frozen=frozen)
        self.goal = torch.tensor([goal]).double()
        self.wall, self.after_refresh = wall, after_refresh
        self.evaluations = self.refreshes = 0

    def refresh(self):
        self.refreshes += 1
        if self.after_refresh is not None:
            self.goal = torch.tensor([self.after_refresh]).double()

    def __call__(self):
        self.evaluations += 1
        transl = self.state.unpack().transl
        value = 100 * (transl - self.goal).square().sum(-1)
        if self.wall is not None and transl[0, 2] > self.wall:
            value = value * torch.nan
        return {"bowl": value, "quarter": value / 4}


@pytest.mark.parametrize(("settings", "within"), [(LBFGS, 1e-3), (replace(ADAM, steps=400), 1e-2)])
def test_the_optimiser_reaches_a_known_minimum(settings, within):
    energy = Bowl()
    trace = settings.minimise(energy)
    torch.testing.assert_close(energy.state.unpack().transl, energy.goal, atol=within, rtol=0)
    # 100 * (0.3^2 + 0.2^2 + 1^2) at the start.
    assert trace.start == pytest.approx({"bowl": 113.0, "quarter": 28.25})
    assert trace.end["bowl"] < 1e-2
    assert trace.evaluations <= energy.evaluations <= trace.evaluations + 2


def two_loops(pairs, gradient):
    """L-BFGS as textbooks write it (Nocedal and Wright, algorithm 7.4)."""
    q, alphas = gradient.clone(), []
    for s, y in reversed(pairs):
        alphas.append((s @ q) / (s @ y))
        q = q - alphas[-1] * y
    s, y = pairs[-1]
    q = q * (s @ y) / (y @ y)
    for (s, y), alpha in zip(pairs, reversed(alphas), strict=True):
        q = q + s * (alpha - (y @ q) / (s @ y))
    return -q


@pytest.mark.parametrize("count", [1, 2, 7, 40, 60])
def test_the_direction_is_that_of_the_two_loops(count):
    g = torch.Generator().manual_seed(count)
    root = torch.randn(90, 90, generator=g).double()
    hessian = root @ root.T + torch.eye(90).double()
    curvature, pairs = LbfgsHistory(), []
    for _ in range(count):
        step = torch.randn(90, generator=g).double()
        pairs.append((step, hessian @ step))
        curvature.add(*pairs[-1])
    gradient = torch.randn(90, generator=g).double()
    want = two_loops(pairs[-40:], gradient)
    torch.testing.assert_close(curvature.direction(gradient), want, rtol=1e-6, atol=1e-6 * want.norm().item())


def test_a_step_along_which_the_energy_bends_down_teaches_nothing():
    curvature = LbfgsHistory()
    gradient = torch.tensor([3.0, 4.0])
    before = curvature.direction(gradient)
    torch.testing.assert_close(before, -0.1 * gradient)  # half a unit long
    curvature.add(torch.tensor([1.0, 0.0]), torch.tensor([-1.0, 0.0]))
    assert torch.equal(curvature.direction(gradient), before)


def test_looks_anew_at_least_every_thirty_steps():
    energy = Bowl()
    trace = ADAM.minimise(energy)
    assert trace.steps == 100
    assert energy.refreshes == 4  # after 30, 60 and 90 steps, and at the end


def test_stops_when_a_refreshs_steps_no_longer_help():
    energy = Bowl()
    progress: list[float] = []
    trace = replace(LBFGS, steps=1000, refresh_steps=10).minimise(energy, progress.append)
    assert trace.steps <= 40
    # Progress is progress after each block and at the end; the last block changed nothing to look at.
    assert energy.refreshes == len(progress) - 2


def test_the_optimiser_avoids_nan():
    energy = Bowl(wall=2.5)
    trace = LBFGS.minimise(energy)
    assert torch.isfinite(energy.state.pack()).all()
    place = energy.state.unpack().transl[0]
    assert 2.0 < place[2] <= 2.5
    assert trace.end["bowl"] < trace.start["bowl"]


def test_adam_returns_its_best_step_before_the_energy_became_nan():
    energy = Bowl(wall=2.3)
    trace = ADAM.minimise(energy)
    assert torch.isfinite(energy.state.pack()).all()
    assert energy.state.unpack().transl[0, 2] <= 2.3
    assert trace.end["bowl"] < trace.start["bowl"]


@pytest.mark.parametrize("settings", [LBFGS, ADAM])
def test_never_ends_worse_than_it_began(settings):
    """The last refresh moves the minimum behind the start. L-BFGS returns there; Adam searches from there again."""
    energy = Bowl(goal=(0.0, 0.0, 3.0), after_refresh=(0.0, 0.0, 1.9))
    trace = replace(settings, steps=20, refresh_steps=20).minimise(energy)
    if settings is LBFGS:
        torch.testing.assert_close(energy.state.unpack().transl, torch.tensor([[0.0, 0.0, 2.0]]).double())
        assert trace.end == trace.start
    else:
        assert trace.end["bowl"] < trace.start["bowl"] == pytest.approx(100 * 0.1**2)
