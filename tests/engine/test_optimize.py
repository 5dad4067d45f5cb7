"""Minimising: known minima are reached, no step goes where there are no numbers, and a person who
ends worse than they began goes back to their own start.
"""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch.testing import assert_close

from physic_core.engine.joint.optimiser import (
    LbfgsOptimiser,
    revert_if_worse,
)
from physic_core.engine.joint.variables import Variables
from physic_paper.adam import AdamOptimiser

LBFGS = LbfgsOptimiser(steps=40, refresh_steps=20, tolerance=0.0)
ADAM = AdamOptimiser(learning_rate=0.5, steps=200, refresh_steps=50)
STARTS = torch.tensor([[0.0, 0.0, 2.0], [1.0, 0.0, 3.0]]).double()
GOALS = torch.tensor([[0.3, -0.2, 2.5], [0.8, 0.1, 3.4]]).double()


class Two:
    """Pulls each of two people to a goal, in units of the scene's scale, which has a goal of its
    own; counts what is asked of it.
    """

    def __init__(self, *, scale=None, wall=math.inf, after_refresh=None):
        eye = torch.eye(3).double().expand(2, 55, 3, 3)
        frozen = ["root", "pose", "hands", "betas", "offset", *([] if scale else ["scale"])]
        self.variables = Variables(eye, torch.zeros(2, 2).double(), STARTS, STARTS, frozen=frozen)
        self.goals = GOALS.clone()
        self.wall = wall
        self.after_refresh = after_refresh
        self.scale = scale
        self.evaluations = self.refreshes = 0

    def refresh(self):
        self.refreshes += 1
        if self.after_refresh is not None:
            self.goals[0] = self.after_refresh

    def __call__(self):
        self.evaluations += 1
        estimate = self.variables.unpack()
        own = 100 * (estimate.transl - self.goals * estimate.log_scale.exp()).square().sum(-1)
        beyond = (estimate.transl[:, 0] > self.wall) & torch.tensor([True, False])
        energies = {"own": own * torch.where(beyond, torch.nan, 1.0)}
        if self.scale:
            energies["scale"] = 1e4 * (estimate.log_scale - self.scale).square().reshape(1)
        return energies

    def places(self):
        return self.variables.unpack().transl.detach()


@pytest.mark.parametrize(
    ("settings", "within"), [(LbfgsOptimiser(), 1e-3), (replace(ADAM, steps=400), 1e-2)]
)
def test_the_optimiser_reaches_a_known_minimum(settings, within):
    energy = Two(scale=0.1)
    trace = settings.minimise(energy)
    assert_close(energy.places(), GOALS * math.exp(0.1), atol=within, rtol=0)
    # 100 * (0.3^2 + 0.2^2 + 0.5^2 + 0.2^2 + 0.1^2 + 0.4^2) and 1e4 * 0.1^2 at the start.
    assert trace.start == pytest.approx({"own": 59.0, "scale": 100.0})
    assert sum(trace.end.values()) < 1e-2
    assert trace.evaluations <= energy.evaluations <= trace.evaluations + 2


def test_visibility_is_updated_after_each_block_of_steps_and_at_the_end():
    energy = Two()
    trace = replace(ADAM, steps=100, refresh_steps=30).minimise(energy)
    assert trace.steps == 100
    assert energy.refreshes == 4


def test_the_optimiser_stops_when_its_steps_hardly_lower_the_energy():
    energy = Two()
    progress = []
    settings = LbfgsOptimiser(steps=1000, refresh_steps=10)
    assert settings.minimise(energy, progress.append).steps <= 40
    # Progress is progress after each block and at the end; the last block changed nothing to look
    # at.
    assert energy.refreshes == len(progress) - 2


@pytest.mark.parametrize(("settings", "within"), [(LBFGS, 0.3), (ADAM, 0.01)])
def test_a_person_with_nan_energy_is_held_and_the_other_goes_on(settings, within):
    """Beyond the wall the first person's energy is not a number; one line search for all people
    ends there.
    """
    energy = Two(wall=1.0)
    energy.goals[0] = torch.tensor([1.5, 0.0, 2.0])
    trace = settings.minimise(energy)
    places = energy.places()
    assert trace.end["own"] < trace.start["own"]
    assert 0.2 < places[0, 0] <= 1.0
    assert_close(places[1], GOALS[1], atol=within, rtol=0)


@pytest.mark.parametrize("settings", [LBFGS, ADAM], ids=["lbfgs", "adam"])
def test_only_the_person_who_ends_worse_returns_to_the_start(settings):
    """The last update of the first person's view makes their start better than what they have
    reached.
    """
    energy = Two(after_refresh=STARTS[0])
    trace = replace(settings, refresh_steps=settings.steps).minimise(energy)
    places = energy.places()
    assert_close(places[0], STARTS[0])
    assert_close(places[1], GOALS[1], atol=0.01, rtol=0)
    assert trace.end["own"] < trace.start["own"]


def test_adam_at_a_lower_rate_improves_a_start_that_the_first_steps_lose():
    """The goals are 2 mm off; a step of Adam is half a metre, then 5 cm."""
    energy = Two()
    energy.goals = STARTS + 0.002
    trace = replace(ADAM, steps=20, refresh_steps=20).minimise(energy)
    assert torch.linalg.vector_norm(energy.places() - energy.goals, dim=1).max() < 0.002
    assert 0 < trace.end["own"] < trace.start["own"] == pytest.approx(2 * 100 * 3 * 0.002**2)
    assert trace.steps == 40


def test_the_total_never_rises_even_where_people_are_bound_to_each_other():
    """The first gains and the second loses by their common way, and to part would cost more than
    either.
    """

    class Bound(Two):
        def __call__(self):
            moved = self.variables.values["translation"][:, 0]
            parted = 100 * (moved[0] - moved[1]).square()
            return {"own": moved * torch.tensor([-1.0, 2.0]), "between": parted.expand(2)}

    energy = Bound()
    start = energy.variables.pack()
    with torch.no_grad():
        energy.variables.values["translation"][:, 0] += 1.0
    before, after = revert_if_worse(energy, energy.variables.pack(), start)
    assert before == after == {"own": 0.0, "between": 0.0}
    assert_close(energy.variables.pack(), start)
