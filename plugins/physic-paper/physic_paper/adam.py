"""Adam, the optimiser of the paper.

Its first steps can lose a start that is nearly optimal: it is then repeated with a tenth of the learning rate, at most
twice.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physic_core.engine.bounds import Count, Positive, PositiveCount
from physic_core.engine.joint.acceptance import Energy, energy_per_person, total_energy
from physic_core.engine.joint.optimiser import Block, MinimisationResult, join_results, minimise_in_blocks
from physic_core.engine.joint.settings import OptimiserSettings, Progress

__all__ = ["AdamSettings"]

_RATE_CUTS = 2  # restarts with a tenth of the learning rate, for people whose energy has only increased


@dataclass(frozen=True)
class AdamSettings(OptimiserSettings):
    """Settings of Adam.

    Attributes:
        steps: all of them are taken.
        refresh_steps: steps between two updates of visibility.
        learning_rate: of the raw parameters.
    """

    steps: Count = 100
    refresh_steps: PositiveCount = 30
    learning_rate: Positive = 1e-2

    def minimise(
        self, energy: Energy, progress: Progress | None = None, groups: Tensor | None = None
    ) -> MinimisationResult:
        """Minimise an energy by Adam."""
        origin = energy.state.pack()
        result = self._minimise_once(energy, progress, groups)
        rate = self.learning_rate
        for _ in range(_RATE_CUTS):
            if not energy.state.parameters() or bool(energy.state.people_changed(origin).all()):
                break
            rate /= 10
            again = replace(self, learning_rate=rate)._minimise_once(energy, None, groups)
            result = join_results(energy, origin, result, again)
        return result

    def _minimise_once(self, energy: Energy, progress: Progress | None, groups: Tensor | None) -> MinimisationResult:
        parameters = energy.state.parameters()
        optimiser = torch.optim.Adam(parameters, lr=self.learning_rate) if parameters else None

        def take_steps(steps: int) -> Block:
            assert optimiser is not None
            return _take_steps(energy, optimiser, steps)

        return minimise_in_blocks(energy, self, take_steps, progress, groups)


def _take_steps(energy: Energy, optimiser: torch.optim.Adam, steps: int) -> Block:
    """Take Adam steps between two refreshes. Its moments are kept over refreshes, and steps may raise the energy.

    People with non-finite gradients return to the previous step and are kept there until the next refresh.
    """
    state = energy.state
    parameters = state.parameters()
    held: Tensor | None = None
    good = state.pack()
    totals: list[float] = []
    for _ in range(steps):
        total, broken = _differentiate(energy, parameters)
        if bool(broken.any()):
            state.load_people(good, broken)
            held = broken if held is None else held | broken
            total, broken = _differentiate(energy, parameters)
            if bool(broken.any()):
                break
        totals.append(total)
        good = state.pack()
        optimiser.step()
        if held is not None:
            state.load_people(good, held)
    total, broken = _differentiate(energy, parameters)
    if bool(broken.any()):
        state.load_people(good, broken)
    return Block(totals[0] if totals else total, total, len(totals) + 1, len(totals))


def _differentiate(energy: Energy, parameters: list[Tensor]) -> tuple[float, Tensor]:
    """Compute the gradients; return the energy, and which people (B,) bool have non-finite energy or gradients."""
    energies = energy()
    total = total_energy(energies)
    gradients = torch.autograd.grad(total, parameters, allow_unused=True)
    broken = ~torch.isfinite(energy_per_person(energies))
    for p, gradient in zip(parameters, gradients, strict=True):
        p.grad = torch.zeros_like(p) if gradient is None else gradient
        # The scale is shared: a non-finite gradient of it stops all people.
        fine = torch.isfinite(p.grad)
        broken = broken | ~(fine.reshape(len(p), -1).all(1) if p.ndim else fine | broken.any())
    return float(total.detach()), broken
