"""Minimising: known minima are reached, no end is worse than its start, and no step goes where
there are no numbers.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physic_core.engine.joint.optimiser import Gradient, LbfgsHistory, LbfgsOptimiser
from physic_core.engine.joint.variables import Variables
from physic_paper.adam import AdamOptimiser

LBFGS = LbfgsOptimiser()
ADAM = AdamOptimiser(learning_rate=0.1, steps=100, refresh_steps=30)


class Bowl:
    """Pulls the translation to a goal; counts what is asked of it."""

    def __init__(self, wall=None):
        eye = torch.eye(3).double().expand(1, 55, 3, 3)
        place = torch.tensor([[0.0, 0.0, 2.0]]).double()
        frozen = ["root", "pose", "hands", "betas", "scale", "offset"]
        self.variables = Variables(eye, torch.zeros(1, 2).double(), place, place, frozen=frozen)
        self.goal = torch.tensor([[0.3, -0.2, 3.0]]).double()
        self.wall = wall
        self.evaluations = self.refreshes = 0

    def refresh(self):
        self.refreshes += 1

    def __call__(self):
        self.evaluations += 1
        transl = self.variables.unpack().transl
        value = 100 * (transl - self.goal).square().sum(-1)
        if self.wall is not None and transl[0, 2] > self.wall:
            value = value * torch.nan
        return {"bowl": value, "quarter": value / 4}


@pytest.mark.parametrize(("settings", "within"), [(LBFGS, 1e-3), (replace(ADAM, steps=400), 1e-2)])
def test_the_optimiser_reaches_a_known_minimum(settings, within):
    energy = Bowl()
    trace = settings.minimise(energy)
    torch.testing.assert_close(energy.variables.unpack().transl, energy.goal, atol=within, rtol=0)
    # 100 * (0.3^2 + 0.2^2 + 1^2) at the start.
    assert trace.start == pytest.approx({"bowl": 113.0, "quarter": 28.25})
    assert trace.end["bowl"] < 1e-2
    assert trace.evaluations <= energy.evaluations <= trace.evaluations + 2


def two_loops(pairs, gradient):
    """L-BFGS as textbooks write it (Nocedal and Wright, algorithm 7.4)."""
    q = gradient.clone()
    alphas = []
    for s, y in reversed(pairs):
        alphas.append((s @ q) / (s @ y))
        q = q - alphas[-1] * y
    s, y = pairs[-1]
    q = q * (s @ y) / (y @ y)
    for (s, y), alpha in zip(pairs, reversed(alphas), strict=True):
        q = q + s * (alpha - (y @ q) / (s @ y))
    return -q


def directions_of(hessians, count, generator, groups=None, coupled=None):
    """Add steps of a quadratic energy to a history: the direction, the pairs of the whole, and a
    gradient.

    Args:
        hessians: (B, D + 1, D + 1) of each person and the scale.
        coupled: (B * D + 1, B * D + 1) Hessian of what people share beside the scale, or None.
    """
    people = len(hessians)
    size = hessians.shape[1] - 1
    history = LbfgsHistory(groups)
    pairs = []

    def random_step():
        return torch.randn(people, size, generator=generator).double(), torch.randn(
            (), generator=generator
        ).double()

    def gradient_at(x, t):
        g = torch.einsum("bij,bj->bi", hessians, torch.cat([x, t.expand(people, 1)], 1))
        found = g[:, :-1]
        shares = g[:, -1]
        if coupled is not None:
            found = found + (coupled @ x.reshape(-1)).view_as(x)
        return Gradient(found, shares)

    zero = gradient_at(torch.zeros(people, size).double(), torch.zeros(()).double())
    history.direction(zero)
    for _ in range(count):
        x, t = random_step()
        change = gradient_at(x, t)
        history.add(x, t, zero, change)
        pairs.append(
            (
                torch.cat([x.reshape(-1), t[None]]),
                torch.cat([change.people.reshape(-1), change.scale.sum()[None]]),
            )
        )
    return history, pairs, gradient_at(*random_step())


def flat(people, scale):
    return torch.cat([people.reshape(-1), scale.reshape(1)])


def random_hessians(people, size, generator):
    root = torch.randn(people, size + 1, size + 1, generator=generator).double()
    return root @ root.mT + torch.eye(size + 1).double()


@pytest.mark.parametrize("count", [1, 2, 7, 40, 60])
@pytest.mark.parametrize("people", [1, 3])
def test_one_group_has_the_direction_of_the_two_loop_recursion(count, people):
    g = torch.Generator().manual_seed(count)
    history, pairs, gradient = directions_of(
        random_hessians(people, 30, g), count, g, torch.zeros(people, dtype=torch.int64)
    )
    want = two_loops(pairs[-40:], flat(gradient.people, gradient.scale.sum()))
    torch.testing.assert_close(
        flat(*history.direction(gradient)), want, rtol=1e-6, atol=1e-6 * want.norm().item()
    )


@pytest.mark.parametrize("groups", [None, torch.tensor([0, 1, 1, 3])])
def test_a_history_for_each_group_gives_steps_nearer_to_newtons_than_one_history(groups):
    g = torch.Generator().manual_seed(0)
    people = 4
    size = 3
    hessians = random_hessians(people, size, g)
    coupled = None
    if groups is not None:
        link = torch.randn(2 * size, 2 * size, generator=g).double()
        coupled = torch.zeros(people * size, people * size).double()
        coupled[size : 3 * size, size : 3 * size] = link @ link.T
    history, _, gradient = directions_of(hessians, 12, g, groups, coupled)
    whole = torch.zeros(people * size + 1, people * size + 1).double()
    if coupled is not None:
        whole[:-1, :-1] = coupled
    for i, hessian in enumerate(hessians):
        rows = torch.tensor([*range(i * size, (i + 1) * size), people * size])
        whole[rows[:, None], rows] += hessian
    newton = -torch.linalg.solve(whole, flat(gradient.people, gradient.scale.sum()))
    found = flat(*history.direction(gradient))
    g = torch.Generator().manual_seed(0)
    of_all = torch.zeros(people, dtype=torch.int64)
    pooled, _, _ = directions_of(random_hessians(people, size, g), 12, g, of_all, coupled)
    alike = [
        torch.cosine_similarity(step, newton, 0)
        for step in (found, flat(*pooled.direction(gradient)))
    ]
    assert alike[0] > 0.9 > alike[1]


def test_a_step_of_negative_curvature_is_not_stored_for_that_person():
    history = LbfgsHistory()
    gradient = Gradient(torch.tensor([[3.0, 4.0], [0.0, 0.0]]), None)
    before, _ = history.direction(gradient)
    torch.testing.assert_close(before, -0.1 * gradient.people)  # half a unit long
    after = Gradient(gradient.people + torch.tensor([[-1.0, 0.0], [2.0, 0.0]]), None)
    history.add(torch.tensor([[1.0, 0.0], [1.0, 0.0]]), None, gradient, after)
    same, _ = history.direction(gradient)
    torch.testing.assert_close(same, before)
    other, _ = history.direction(Gradient(torch.tensor([[3.0, 4.0], [1.0, 0.0]]), None))
    torch.testing.assert_close(other[1], torch.tensor([-0.5, 0.0]))


def test_visibility_is_updated_at_least_every_thirty_steps():
    energy = Bowl()
    trace = ADAM.minimise(energy)
    assert trace.steps == 100
    assert energy.refreshes == 4  # after 30, 60 and 90 steps, and at the end


def test_the_optimiser_stops_when_its_steps_hardly_lower_the_energy():
    energy = Bowl()
    progress = []
    trace = replace(LBFGS, steps=1000, refresh_steps=10).minimise(energy, progress.append)
    assert trace.steps <= 40
    # Progress is progress after each block and at the end; the last block changed nothing to look
    # at.
    assert energy.refreshes == len(progress) - 2


def test_the_optimiser_avoids_nan():
    energy = Bowl(wall=2.5)
    trace = LBFGS.minimise(energy)
    assert torch.isfinite(energy.variables.pack()).all()
    place = energy.variables.unpack().transl[0]
    assert 2.0 < place[2] <= 2.5
    assert trace.end["bowl"] < trace.start["bowl"]
