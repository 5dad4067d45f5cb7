"""A person who ends worse than they began goes back to their own start; no one else does."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physic_core.engine.joint.optimiser import LbfgsOptimiser, keep_lowest_energy, revert_if_worse
from physic_core.engine.joint.variables import Variables
from physic_paper.adam import AdamOptimiser

LBFGS = LbfgsOptimiser(steps=40, refresh_steps=20, tolerance=0.0)
ADAM = AdamOptimiser(learning_rate=0.5, steps=200, refresh_steps=50)
STARTS = torch.tensor([[0.0, 0.0, 2.0], [1.0, 0.0, 3.0]]).double()
GOALS = torch.tensor([[0.3, -0.2, 2.5], [0.8, 0.1, 3.4]]).double()


class Two:
    """Pulls each of two people to a goal, in units of the scene's scale, which has a goal of its
    own.
    """

    def __init__(self, *, scale=None, wall=None, after_refresh=None):
        eye = torch.eye(3).double().expand(2, 55, 3, 3)
        frozen = ["root", "pose", "hands", "betas", "offset", *([] if scale else ["scale"])]
        self.variables = Variables(eye, torch.zeros(2, 2).double(), STARTS, STARTS, frozen=frozen)
        self.goals = GOALS.clone()
        self.wall = wall
        self.after_refresh = after_refresh
        self.scale = scale

    def refresh(self):
        if self.after_refresh is not None:
            self.goals[0] = self.after_refresh

    def __call__(self):
        estimate = self.variables.unpack()
        own = 100 * (estimate.transl - self.goals * estimate.log_scale.exp()).square().sum(-1)
        if self.wall is not None:
            beyond = torch.stack([estimate.transl[0, 0] > self.wall, torch.tensor(False)])
            own = own * torch.where(beyond, torch.nan, 1.0)
        energies = {"own": own}
        if self.scale:
            energies["scale"] = 1e4 * (estimate.log_scale - self.scale).square().reshape(1)
        return energies

    def places(self):
        return self.variables.unpack().transl.detach()


@pytest.mark.parametrize("settings", [LBFGS, ADAM], ids=["lbfgs", "adam"])
def test_only_the_person_who_ends_worse_returns_to_the_start(settings):
    """The last update of the first person's view makes their start better than what they have
    reached.
    """
    energy = Two(after_refresh=STARTS[0])
    trace = replace(settings, refresh_steps=settings.steps).minimise(energy)
    places = energy.places()
    torch.testing.assert_close(places[0], STARTS[0])
    torch.testing.assert_close(places[1], GOALS[1], atol=0.01, rtol=0)
    assert trace.end["own"] < trace.start["own"]


def test_adam_at_a_lower_rate_improves_a_start_that_the_first_steps_lose():
    """The goals are 2 mm off; a step of Adam is half a metre, then 5 cm."""
    energy = Two()
    energy.goals = STARTS + 0.002
    trace = replace(ADAM, steps=20, refresh_steps=20).minimise(energy)
    assert torch.linalg.vector_norm(energy.places() - energy.goals, dim=1).max() < 0.002
    assert 0 < trace.end["own"] < trace.start["own"] == pytest.approx(2 * 100 * 3 * 0.002**2)
    assert trace.steps == 40


def test_a_person_with_nan_energy_is_held_and_the_other_converges():
    """Beyond the wall the first person's energy is not a number."""
    energy = Two(wall=1.0)
    energy.goals[0] = torch.tensor([1.5, 0.0, 2.0])
    trace = ADAM.minimise(energy)
    places = energy.places()
    assert trace.end["own"] < trace.start["own"]
    assert 0.5 < places[0, 0] <= 1.0
    torch.testing.assert_close(places[1], GOALS[1], atol=0.01, rtol=0)


@pytest.mark.parametrize("settings", [LBFGS, ADAM], ids=["lbfgs", "adam"])
def test_where_all_end_better_the_end_stays(settings):
    energy = Two(scale=0.1)
    trace = replace(settings, steps=200).minimise(energy)
    torch.testing.assert_close(
        energy.places(), GOALS * torch.exp(torch.tensor(0.1)), atol=0.02, rtol=0
    )
    assert sum(trace.end.values()) < 0.01 * sum(trace.start.values())


def test_the_one_scale_is_the_one_with_the_lowest_total():
    energy = Two(scale=0.1)
    start = energy.variables.pack()
    with torch.no_grad():
        energy.variables.values["scale"].fill_(1.0)  # log(scale) 0.1, as it should be
        energy.variables.load_people(start, torch.ones(2, dtype=torch.bool))
    end = energy.variables.pack()
    keep_lowest_energy(energy, (start, end))
    torch.testing.assert_close(energy.variables.pack(), end)


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
    torch.testing.assert_close(energy.variables.pack(), start)


def test_people_of_one_group_keep_their_common_end():
    """The first person loses by the motion less than the second one gains."""
    energy = Two()
    start = energy.variables.pack()
    with torch.no_grad():
        energy.variables.values["translation"][1] += 1.0
        energy.goals[1] = energy.places()[1]
        energy.variables.values["translation"][0] -= 0.1
    end = energy.variables.pack()
    alone = []
    together = []
    for groups, places in ((None, alone), (torch.tensor([0, 0]), together)):
        energy.variables.load(end)
        revert_if_worse(energy, end, start, groups)
        places.append(energy.places())
    torch.testing.assert_close(alone[0][0], STARTS[0])
    energy.variables.load(end)
    torch.testing.assert_close(together[0], energy.places())
