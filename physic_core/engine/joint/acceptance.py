"""Nobody ends worse than they began: decided by each person's own energy, at the one scale of their scene.

All people share the scene's scale, so that a person's energy is comparable between two states at one scale only. For
the scale of each state every person takes the state in which their own energy is lower; of these, the scale with the
lowest total is kept. Whoever did not gain is put back to their own start, and nobody else with them; and the total is
never higher than at the start, which is one of the choices.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Protocol

import torch
from torch import Tensor

from physic_core.engine.joint.state import State

__all__ = ["Energy", "accept", "best_of", "per_person", "total_of", "values_of"]

_SHARED = "scale"  # the term that belongs to the scene and to no person


class Energy(Protocol):
    """What can be minimised."""

    state: State

    def __call__(self) -> Mapping[str, Tensor]:
        """Weighted terms at the present state, (B,) each, and "scale" of the scene; differentiable."""

    def refresh(self) -> None:
        """Update visibility and nearest points to the present state."""


def total_of(energies: Mapping[str, Tensor]) -> Tensor:
    """Sum of all terms: ()."""
    return torch.cat([value.reshape(-1) for value in energies.values()]).sum()


def per_person(energies: Mapping[str, Tensor]) -> Tensor:
    """(B,) sum of the terms of each person, without what belongs to the scene."""
    return torch.stack([value for name, value in energies.items() if name != _SHARED]).sum(0)


def values_of(energies: Mapping[str, Tensor]) -> dict[str, float]:
    """Each term's sum."""
    sums = torch.stack([value.detach().sum() for value in energies.values()]) if energies else torch.zeros(0)
    return dict(zip(energies, sums.tolist(), strict=True))


@torch.no_grad()
def accept(energy: Energy, end: Tensor, start: Tensor) -> tuple[dict[str, float], dict[str, float]]:
    """Leave everybody at their end, or at their start where that is better for themselves.

    Args:
        energy: its visibility is that of the end.
        end: packed state.
        start: packed state.

    Returns:
        each term at the start, and where people were left, both under the same visibility.
    """
    state = energy.state
    state.load(start)
    before = energy()
    state.load(end)
    after = energy()
    if not bool((_finite(after) <= _finite(before)).all()) or not _sum(after) <= _sum(before):
        best_of(energy, (end, start))
        after = energy()
        if not _sum(after) <= _sum(before):  # terms between people bind one to where another was
            state.load(start)
            after = before
        if not torch.equal(state.pack(), end):
            energy.refresh()
    return values_of(before), values_of(after)


@torch.no_grad()
def best_of(energy: Energy, states: Sequence[Tensor], *, refresh: bool = False) -> None:
    """Put everybody where their own energy is lowest, at the scale of the scene at which the total is.

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
            # Someone whose energy is not a number in any state counts in none, and says nothing about the others.
            known = torch.isfinite(own)
            value = (float((~known).sum()), float(own[known].sum()) + scale)
            if value < best:
                best, chosen = value, mixed
    state.load(chosen)
    if refresh:
        energy.refresh()


def _finite(energies: Mapping[str, Tensor]) -> Tensor:
    """(B,) of each person, infinite where it is not a number."""
    own = per_person(energies)
    return torch.where(torch.isfinite(own), own, torch.inf)


def _sum(energies: Mapping[str, Tensor]) -> float:
    total = float(total_of(energies))
    return total if math.isfinite(total) else math.inf
