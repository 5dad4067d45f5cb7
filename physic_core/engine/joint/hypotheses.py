"""Hypotheses about people that are decided by comparing energies: does a hand touch what it meets in the picture?"""

from __future__ import annotations

import torch
from torch import Tensor

from physic_core.engine.joint.acceptance import energy_per_person
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.optimiser import MinimisationResult, OptimiserSettings, join_results
from physic_core.engine.joint.terms.joins import JoinSettings, JoinTerm, find_joins


def decide_joins(
    energy: JointEnergy, settings: JoinSettings, optimiser: OptimiserSettings
) -> MinimisationResult | None:
    """Minimise an energy with each possible join in turn, and keep those that the other terms allow.

    Args:
        energy: minimised without joins; its state is changed if a join is kept.
        settings: of joins.
        optimiser: of the energy, with and without a join.

    Returns:
        None if no join is kept.
    """
    start, result = energy.state.pack(), None
    term = JoinTerm(settings)
    for join in find_joins(settings, energy.context, energy.snapshot.vertices):
        before, people = energy.state.pack(), sorted({join.person, join.other})
        with energy.state.holding_all_but(people):
            optimiser.minimise(energy)  # so that both have converged alike
            without = energy.state.pack()
            if term not in energy.terms:
                energy.add_terms([term])
            term.joins = (*term.joins, join)
            energy.refresh()
            groups = torch.arange(len(energy.problem), device=start.device)
            groups[people] = people[0]
            tried = optimiser.minimise(energy, groups=groups)
            energy.refresh()
            rise = float(_rise(energy, without)[people].sum())
        if rise <= settings.max_rise and join.nearest(energy.snapshot.vertices)[0] <= 2 * settings.sigma_m:
            result = tried if result is None else join_results(energy, start, result, tried)
        else:
            term.joins = term.joins[:-1]
            energy.state.load(before)
            energy.refresh()
    return result


@torch.no_grad()
def _rise(energy: JointEnergy, before: Tensor) -> Tensor:
    """Return how much each person's energy without joins exceeds that of another state: (B,), of weight 1."""
    after = energy.state.pack()
    found = []
    for state in (before, after):
        energy.state.load(state)
        found.append(energy_per_person({name: value for name, value in energy().items() if name != "joins"}))
    return (found[1] - found[0]) / energy.person_weights
