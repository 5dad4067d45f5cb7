"""Accept the optimised state per person: no person ends with a higher energy than at the start.

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

__all__ = ["Energy", "accept", "best_of", "per_person", "total_of", "values_of"]

_SHARED = "scale"  # the term of the scene, not of a person


class Energy(Protocol):
    """An energy over a state that can be minimised."""

    state: State

    def __call__(self) -> Mapping[str, Tensor]:
        """Weighted terms at the present state, (B,) each, and "scale" of the scene; differentiable."""

    def refresh(self) -> None:
        """Update visibility and nearest points to the present state."""


def total_of(energies: Mapping[str, Tensor]) -> Tensor:
    """Sum of all terms: ()."""
    return torch.cat([value.reshape(-1) for value in energies.values()]).sum()


def per_person(energies: Mapping[str, Tensor]) -> Tensor:
    """(B,) sum of the terms of each person, without the term of the scene."""
    return torch.stack([value for name, value in energies.items() if name != _SHARED]).sum(0)


def values_of(energies: Mapping[str, Tensor]) -> dict[str, float]:
    """Term -> its sum over people."""
    sums = torch.stack([value.detach().sum() for value in energies.values()]) if energies else torch.zeros(0)
    return dict(zip(energies, sums.tolist(), strict=True))


@torch.no_grad()
def accept(energy: Energy, end: Tensor, start: Tensor) -> tuple[dict[str, float], dict[str, float]]:
    """Set each person to the end state, or to the start where their own energy is lower there.

    Args:
        energy: its visibility is that of the end.
        end: packed state.
        start: packed state.

    Returns:
        Each term at the start and at the accepted state, both under the visibility of ``end``.
    """
    state = energy.state
    state.load(start)
    before = energy()
    state.load(end)
    after = energy()
    if not bool((_finite(after) <= _finite(before)).all()) or not _sum(after) <= _sum(before):
        best_of(energy, (end, start))
        after = energy()
        if not _sum(after) <= _sum(before):  # terms between people depend on the other people's states
            state.load(start)
            after = before
        if not torch.equal(state.pack(), end):
            energy.refresh()
    return values_of(before), values_of(after)


@torch.no_grad()
def best_of(energy: Energy, states: Sequence[Tensor], *, refresh: bool = False) -> None:
    """Set each person to their state of lowest energy, at the scene's scale with the lowest total.

    Args:
        energy: its state is changed.
        states: packed, at least one.
        refresh: compare each state under its own visibility, instead of all under the present one.
    """
    state = energy.state
    everybody = torch.ones(state.people, dtype=torch.bool, device=states[0].device)
    best, chosen = (math.inf, math.inf), states[0]
    for shared in states:
        mixed, own, scale = None, None, 0.0
        for other in states:
            state.load(shared)
            state.put(other, everybody)
            if refresh:
                energy.refresh()
            energies = energy()
            scale = float(energies[_SHARED].sum()) if _SHARED in energies else 0.0
            found = _finite(energies)
            if mixed is None or own is None:
                mixed, own = state.pack(), found
                continue
            better = found < own
            state.load(mixed)
            state.put(other, better)
            mixed, own = state.pack(), torch.where(better, found, own)
        if own is not None and mixed is not None:
            # A person with non-finite energy in all states is left out of the totals.
            known = torch.isfinite(own)
            value = (float((~known).sum()), float(own[known].sum()) + scale)
            if value < best:
                best, chosen = value, mixed
    state.load(chosen)
    if refresh:
        energy.refresh()


def _finite(energies: Mapping[str, Tensor]) -> Tensor:
    """(B,) energy of each person, inf where it is not finite."""
    own = per_person(energies)
    return torch.where(torch.isfinite(own), own, torch.inf)


def _sum(energies: Mapping[str, Tensor]) -> float:
    total = float(total_of(energies))
    return total if math.isfinite(total) else math.inf
