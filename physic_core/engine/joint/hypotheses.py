"""Hypotheses about people that are decided by comparing energies: does a hand touch what it meets in the image?"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from physic_core.engine.joint.acceptance import energy_per_person, term_totals
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
    start, kept, result = energy.state.pack(), JoinTerm(settings), None
    for join in find_joins(settings, energy.context, energy.snapshot.vertices):
        # The others are constant, and share energy with nobody whom they do not touch.
        rows = torch.isin(energy.groups, energy.groups[[join.person, join.other]]).nonzero(as_tuple=True)[0]
        inside = rows.tolist()
        term = JoinTerm(settings, tuple(each.among(inside) for each in kept.joins if each.person in inside))
        part, tried = energy.of_people(rows), join.among(inside)
        part.add_terms([term])
        people = sorted({tried.person, tried.other})
        with part.state.holding_all_but(people):
            optimiser.minimise(part)  # so that both have converged alike
            without = part.state.pack()
            term.joins = (*term.joins, tried)
            part.refresh()
            groups = torch.arange(len(rows), device=start.device)
            groups[people] = people[0]
            found = optimiser.minimise(part, groups=groups)
            part.refresh()
            rise = float(_rise(part, without)[people].sum())
        if rise <= settings.max_rise and tried.nearest(part.snapshot.vertices)[0] <= 2 * settings.sigma_m:
            part.state.copy_into(energy.state, rows)
            kept.joins = (*kept.joins, join)
            if kept not in energy.terms:
                energy.add_terms([kept])
            energy.refresh()
            with torch.no_grad():
                found = replace(found, end=term_totals(energy()))
            result = found if result is None else join_results(energy, start, result, found)
    return result


@torch.no_grad()
def _rise(energy: JointEnergy, before: Tensor) -> Tensor:
    """Return by how much each person's energy without joins exceeds that of another state: (B,), at weight 1."""
    after = energy.state.pack()
    found = []
    for state in (before, after):
        energy.state.load(state)
        found.append(energy_per_person({name: value for name, value in energy().items() if name != "joins"}))
    return (found[1] - found[0]) / energy.context.person_weights
