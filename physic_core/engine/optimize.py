"""Minimise an energy over a state: whitened L-BFGS with a strong-Wolfe line search, or plain Adam.

Both look at visibility anew every few steps, keep the best state, never end worse than they began, and leave out steps
that are not a number.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from physic_core.engine.settings import JointSettings
from physic_core.engine.state import State

__all__ = ["Energy", "Trace", "minimise", "total_of"]

_WALL = 1e30  # stands for an energy that is not a number: the line search turns back from it
_HISTORY = 12  # pairs that L-BFGS remembers


class Energy(Protocol):
    """What can be minimised."""

    state: State

    def __call__(self) -> Mapping[str, Tensor]:
        """Weighted terms at the present state, each of any shape; differentiable."""

    def refresh(self) -> None:
        """Look at visibility and nearest points as the state is now."""


@dataclass(frozen=True)
class Trace:
    """What a minimisation did.

    Attributes:
        start: term -> weighted value of the start, seen as at the end.
        end: term -> weighted value at the end.
        evaluations: of energy and gradient.
        steps: of the optimiser.
        totals: the energy before each refresh's steps and after the last; a refresh may change it by itself.
    """

    start: Mapping[str, float]
    end: Mapping[str, float]
    evaluations: int
    steps: int
    totals: tuple[float, ...]


def total_of(energies: Mapping[str, Tensor]) -> Tensor:
    """Sum of all terms: ()."""
    return torch.stack([value.sum() for value in energies.values()]).sum()


def minimise(energy: Energy, settings: JointSettings, progress: Callable[[float], None] | None = None) -> Trace:
    """Lower ``energy`` by moving its state in place.

    Args:
        energy: refreshed, and finite at its present state.
        settings: of stage 3.
        progress: told the share of steps that are done.
    """
    state = energy.state
    origin = state.pack()
    run = _adam_block if settings.optimiser == "adam" else _lbfgs_block
    memory: dict[str, torch.optim.Optimizer] = {}
    done = evaluations = 0
    totals: list[float] = []
    while done < settings.steps and state.parameters():
        if done:
            energy.refresh()
        block = min(settings.refresh_steps, settings.steps - done)
        before, after, spent = run(energy, settings, block, memory, done + block >= settings.steps)
        totals.append(before)
        evaluations += spent
        done += block
        if progress is not None:
            progress(done / settings.steps)
        if settings.tolerance > 0 and before - after < settings.tolerance * abs(before):
            break
    energy.refresh()
    end = _values(energy)
    final = state.pack()
    state.load(origin)
    start = _values(energy)
    if _sum(end) <= _sum(start):
        state.load(final)
    else:
        end = start
        energy.refresh()
    totals.append(_sum(end))
    if progress is not None:
        progress(1.0)
    return Trace(start, end, evaluations, done, tuple(totals))


Block = tuple[float, float, int]


def _lbfgs_block(
    energy: Energy, settings: JointSettings, steps: int, memory: dict[str, torch.optim.Optimizer], last: bool
) -> Block:
    """One L-BFGS run on one view: energy before and after, evaluations. No curvature is kept over a refresh."""
    state = energy.state
    parameters = state.parameters()
    optimiser = torch.optim.LBFGS(
        parameters,
        lr=1.0,
        max_iter=steps,
        max_eval=2 * steps,
        history_size=_HISTORY,
        tolerance_grad=1e-7,
        tolerance_change=1e-6,
        line_search_fn="strong_wolfe",
    )
    best = _Best(state)

    def closure() -> Tensor:
        total = total_of(energy())
        value = float(total.detach())
        finite = _differentiate(total, parameters) and math.isfinite(value)
        if finite:
            best.offer(value)
            return total.detach()
        for p in parameters:
            p.grad = torch.zeros_like(p)
        return total.new_tensor(_WALL)

    optimiser.step(closure)  # type: ignore[no-untyped-call]
    best.restore()
    return best.first, best.value, best.offers


def _adam_block(
    energy: Energy, settings: JointSettings, steps: int, memory: dict[str, torch.optim.Optimizer], last: bool
) -> Block:
    """Adam on one view. Its path goes on over refreshes, uphill too; the last view's best state is kept."""
    state = energy.state
    parameters = state.parameters()
    if "adam" not in memory:
        memory["adam"] = torch.optim.Adam(parameters, lr=settings.learning_rate)
    optimiser = memory["adam"]
    best = _Best(state)
    for _ in range(steps):
        total = total_of(energy())
        best.offer(float(total.detach()))
        if not _differentiate(total, parameters):
            last = True  # one more step would spread what is not a number
            break
        optimiser.step()
    with torch.no_grad():
        best.offer(float(total_of(energy())))
    if last:
        best.restore()
    return best.first, best.value, best.offers


class _Best:
    """The best state so far in one view."""

    def __init__(self, state: State) -> None:
        self._state = state
        self._packed = state.pack()
        self.first = self.value = math.inf
        self.offers = 0

    def offer(self, value: float) -> None:
        """Say what the energy of the present state is."""
        if not self.offers:
            self.first = value
        self.offers += 1
        if value < self.value:
            self.value = value
            self._packed = self._state.pack()

    def restore(self) -> None:
        """Put the best state back."""
        self._state.load(self._packed)


def _differentiate(total: Tensor, parameters: list[Tensor]) -> bool:
    """Fill in the gradients; whether all of them are numbers."""
    gradients = torch.autograd.grad(total, parameters, allow_unused=True)
    for p, gradient in zip(parameters, gradients, strict=True):
        p.grad = torch.zeros_like(p) if gradient is None else gradient
    return bool(torch.isfinite(torch.stack([p.grad.sum() for p in parameters if p.grad is not None])).all())


@torch.no_grad()
def _values(energy: Energy) -> dict[str, float]:
    return {name: float(value.sum()) for name, value in energy().items()}


def _sum(values: Mapping[str, float]) -> float:
    return math.fsum(values.values()) if all(map(math.isfinite, values.values())) else math.inf
