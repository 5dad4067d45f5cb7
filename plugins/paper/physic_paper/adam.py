"""Adam, the optimiser of the paper.

Its first steps can lose a start that is nearly optimal: it is then repeated with a tenth of the
learning rate, at most twice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import torch
from torch import Tensor

from physic_core.engine.joint import (
    BlockResult,
    EnergyTerms,
    MinimisationResult,
    Optimiser,
    StepProgress,
    energy_per_person,
    join_results,
    total_energy,
)
from physic_core.types import Count, Positive, PositiveCount

_RATE_CUTS = 2  # restarts at a tenth of the rate, for people whose energy has only increased


@dataclass(frozen=True)
class AdamOptimiser(Optimiser):
    """Adam with a fixed learning rate, which restarts lower it."""

    steps: Count = 100
    """All of them are taken."""
    refresh_steps: PositiveCount = 30
    """Steps between two updates of visibility."""
    learning_rate: Positive = 1e-2
    """Step size of the raw parameters."""

    def start(
        self, energy: EnergyTerms, groups: Tensor | None = None
    ) -> Callable[[int], BlockResult]:
        """Return a function that takes steps; the moments are kept over updates."""
        parameters = energy.variables.parameters()
        optimiser = torch.optim.Adam(parameters, lr=self.learning_rate) if parameters else None
        return partial(_take_steps, energy, optimiser)

    def minimise(
        self,
        energy: EnergyTerms,
        progress: StepProgress | None = None,
        groups: Tensor | None = None,
    ) -> MinimisationResult:
        """Take all steps; repeat them at a lower rate while people have kept their start."""
        origin = energy.variables.pack()
        result = super().minimise(energy, progress, groups)
        rate = self.learning_rate
        for _ in range(_RATE_CUTS):
            if not energy.variables.parameters() or energy.variables.people_changed(origin).all():
                break
            rate /= 10
            again = super(AdamOptimiser, replace(self, learning_rate=rate)).minimise(
                energy, groups=groups
            )
            result = join_results(energy, origin, result, again)
        return result


def _take_steps(energy: EnergyTerms, optimiser: torch.optim.Adam | None, steps: int) -> BlockResult:
    """Take Adam steps between two refreshes; steps may raise the energy.

    People with non-finite gradients return to the previous step and are kept there until the next
    refresh.
    """
    assert optimiser is not None  # without free parameters no step is taken
    variables = energy.variables
    parameters = variables.parameters()
    is_broken: Tensor | None = None
    good = variables.pack()
    taken = 0
    for _ in range(steps):
        broken = _differentiate(energy, parameters)
        if broken.any():
            variables.load_people(good, broken)
            is_broken = broken if is_broken is None else is_broken | broken
            broken = _differentiate(energy, parameters)
            if broken.any():
                break
        taken += 1
        good = variables.pack()
        optimiser.step()
        if is_broken is not None:
            variables.load_people(good, is_broken)
    broken = _differentiate(energy, parameters)
    if broken.any():
        variables.load_people(good, broken)
    return BlockResult(taken + 1, taken)


def _differentiate(energy: EnergyTerms, parameters: list[Tensor]) -> Tensor:
    """Compute the gradients; return which people (B,) bool have non-finite energy or gradients."""
    energies = energy()
    total = total_energy(energies)
    gradients = torch.autograd.grad(total, parameters, allow_unused=True)
    broken = ~torch.isfinite(energy_per_person(energies))
    for p, gradient in zip(parameters, gradients, strict=True):
        p.grad = torch.zeros_like(p) if gradient is None else gradient
        # The scale is shared: a non-finite gradient of it stops all people.
        fine = torch.isfinite(p.grad)
        broken = broken | ~(fine.reshape(len(p), -1).all(1) if p.ndim else fine | broken.any())
    return broken
