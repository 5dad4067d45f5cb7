"""Keep the better state of each person: no person ends with a higher energy than at the start.

All people share the scene's scale, so a person's energies in two states are comparable only at one scale. For the scale
of each state, every person takes the state with their lower energy. The scale with the lowest total is kept. Only
people who did not improve return to their start. The start is one of the candidates, so the total never increases.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Protocol

import torch
from torch import Tensor

from physic_core.engine.joint.state import State

_SCENE_TERM = "scale"  # the term of the scene, not of a person


class Energy(Protocol):
    """Energy as a function of its state, for a minimiser that changes the state."""

    state: State

    def __call__(self) -> Mapping[str, Tensor]:
        """Return the weighted terms at the current state: (B,) each, "scale" is (1,); differentiable."""

    def refresh(self) -> None:
        """Update visibility and nearest points to the current state."""


def total_energy(energies: Mapping[str, Tensor]) -> Tensor:
    """Return the sum of all terms: ()."""
    return torch.cat(tuple(energies.values())).sum()


def energy_per_person(energies: Mapping[str, Tensor]) -> Tensor:
    """Return the sum of each person's terms: (B,). The term of the scene is skipped."""
    return torch.stack([value for name, value in energies.items() if name != _SCENE_TERM]).sum(0)


def finite_energy_per_person(energies: Mapping[str, Tensor], groups: Tensor | None = None) -> Tensor:
    """Return the energy of each person: (B,); inf if not finite.

    Args:
        energies: (B,) each.
        groups: (B,) int64, people of one group get the sum of their energies; None if all people are alone.
    """
    own = energy_per_person(energies)
    own = torch.where(torch.isfinite(own), own, torch.inf)
    return own if groups is None else torch.zeros_like(own).index_add(0, groups, own)[groups]


def term_totals(energies: Mapping[str, Tensor]) -> dict[str, float]:
    """Return the sum of each term over all people: term name -> energy."""
    sums = torch.stack([value.detach().sum() for value in energies.values()]) if energies else torch.zeros(0)
    return dict(zip(energies, sums.tolist(), strict=True))


@torch.no_grad()
def revert_if_worse(
    energy: Energy, end: Tensor, start: Tensor, groups: Tensor | None = None
) -> tuple[dict[str, float], dict[str, float]]:
    """Keep the end state of each person, or restore the start state of a person whose energy is lower at the start.

    Args:
        energy: its visibility is that of the end.
        end: packed state.
        start: packed state.
        groups: (B,) int64 of people who touch each other, and are restored together; None if all people are alone.

    Returns:
        Each term at the start and at the accepted state, both under the visibility of ``end``.
    """
    state = energy.state
    state.load(start)
    before = energy()
    state.load(end)
    after = energy()
    better = finite_energy_per_person(after, groups) <= finite_energy_per_person(before, groups)
    if not bool(better.all()) or not _finite_total(after) <= _finite_total(before):
        keep_lowest_energy(energy, (end, start), groups=groups)
        after = energy()
        if not _finite_total(after) <= _finite_total(before):
            # Terms between people depend on the other people's states.
            state.load(start)
            after = before
        if not torch.equal(state.pack(), end):
            energy.refresh()
    return term_totals(before), term_totals(after)


@torch.no_grad()
def keep_lowest_energy(energy: Energy, states: Sequence[Tensor], *, groups: Tensor | None = None) -> None:
    """Set each person to the state of lowest energy, and the scene to the scale with the lowest total energy.

    Args:
        energy: its state is changed.
        states: packed, at least one.
        groups: (B,) int64, see :func:`revert_if_worse`.
    """
    state = energy.state
    everybody = torch.ones(state.num_people, dtype=torch.bool, device=states[0].device)
    best, chosen = (math.inf, math.inf), states[0]
    for shared in states:
        mixed, own, scale = None, None, 0.0
        for other in states:
            state.load(shared)
            state.load_people(other, everybody)
            energies = energy()
            scale = float(energies[_SCENE_TERM].sum()) if _SCENE_TERM in energies else 0.0
            found = finite_energy_per_person(energies, groups)
            if mixed is None or own is None:
                mixed, own = state.pack(), found
                continue
            better = found < own
            state.load(mixed)
            state.load_people(other, better)
            mixed, own = state.pack(), torch.where(better, found, own)
        if own is not None and mixed is not None:
            # A person with non-finite energy in all states is excluded from the totals.
            finite = torch.isfinite(own)
            value = (float((~finite).sum()), float(own[finite].sum()) + scale)
            if value < best:
                best, chosen = value, mixed
    state.load(chosen)


def _finite_total(energies: Mapping[str, Tensor]) -> float:
    """Return the total energy; inf if it is not finite."""
    total = float(total_energy(energies))
    return total if math.isfinite(total) else math.inf
