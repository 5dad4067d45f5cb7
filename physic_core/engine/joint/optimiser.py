"""Minimise an energy over a state: whitened L-BFGS with a backtracking line search, or plain Adam.

Both update visibility every few steps and reject non-finite steps. No person's energy is higher at the end than at the
start (:mod:`physic_core.engine.joint.acceptance`). The scene's scale couples all people, so one L-BFGS optimises them
all. A separate curvature for each person and for the scale took twice as long and stopped centimetres from the minimum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.joint.acceptance import Energy, accept, per_person, total_of
from physic_core.engine.joint.settings import AdamSettings, LbfgsSettings

__all__ = ["Trace", "minimise"]

_HISTORY = 40  # pairs that L-BFGS keeps: vectors of some hundred numbers are cheap compared with one evaluation
_FIRST = 0.5  # length of the very first step, in units of the state
_ARMIJO = 1e-4  # share of the predicted descent that a step must reach
_TRIALS = 10  # lengths at most that a line search tries
_BEND = 1e-8  # least cosine between a step and its change of the gradient
_FLAT = 1e-9  # a slope below this share of the energy is below the resolution of float32
_PATIENCE = 5  # steps that together have to lower the energy by the tolerance


@dataclass(frozen=True)
class Trace:
    """Record of a minimisation.

    Attributes:
        start: term -> weighted value of the start, under the visibility at the end.
        end: term -> weighted value at the end.
        evaluations: number of evaluations of energy and gradient.
        steps: number of steps of the optimiser.
        totals: the energy before each refresh's steps and after the last; a refresh may change the energy.
    """

    start: Mapping[str, float]
    end: Mapping[str, float]
    evaluations: int
    steps: int
    totals: tuple[float, ...]


def minimise(
    energy: Energy, settings: LbfgsSettings | AdamSettings, progress: Callable[[float], None] | None = None
) -> Trace:
    """Lower ``energy`` by moving its state in place.

    Args:
        energy: refreshed, and finite at its present state.
        settings: of the optimiser; their type selects it.
        progress: called with the completed share of the steps, 0-1.
    """
    state = energy.state
    origin = state.pack()
    memory = Memory()
    done = evaluations = taken = 0
    totals: list[float] = []
    converged = False
    while done < settings.steps and state.parameters():
        if done:
            energy.refresh()
        steps = min(settings.refresh_steps, settings.steps - done)
        if isinstance(settings, AdamSettings):
            block = _adam_block(energy, settings, steps, memory)
        else:
            block = _lbfgs_block(energy, settings, steps, memory)
        totals.append(block.before)
        evaluations += block.evaluations
        taken += block.steps
        done += steps
        if progress is not None:
            progress(done / settings.steps)
        converged = isinstance(settings, LbfgsSettings) and _converged(block, settings.tolerance)
        if converged:
            break
    if not converged:  # else the motion since the last update is too small to change visibility
        energy.refresh()
    start, end = accept(energy, state.pack(), origin)
    totals.append(math.fsum(end.values()))
    if progress is not None:
        progress(1.0)
    return Trace(start, end, evaluations, taken, tuple(totals))


@dataclass(frozen=True)
class Block:
    """Steps between two refreshes: energy before and after, evaluations, and steps that were taken."""

    before: float
    after: float
    evaluations: int
    steps: int


def _converged(block: Block, tolerance: float) -> bool:
    """Whether the steps between two refreshes lowered the energy by less than a share of it."""
    return tolerance > 0 and block.before - block.after < tolerance * abs(block.before)


class Memory:
    """State that an optimiser keeps over a refresh."""

    def __init__(self) -> None:
        self.curvature = _Curvature()
        self.adam: torch.optim.Adam | None = None


def _lbfgs_block(energy: Energy, settings: LbfgsSettings, steps: int, memory: Memory) -> Block:
    """L-BFGS steps on one view. The curvature pairs are kept, since the next view's energy is nearly equal."""
    state = energy.state
    parameters = state.parameters()
    curvature = memory.curvature
    spent = 0

    def evaluate(at: Tensor) -> tuple[float, Tensor]:
        nonlocal spent
        spent += 1
        state.load(at)
        total = total_of(energy())
        gradients = torch.autograd.grad(total, parameters, allow_unused=True)
        flat = [torch.zeros_like(p) if g is None else g for p, g in zip(parameters, gradients, strict=True)]
        gradient = torch.cat([g.reshape(-1) for g in flat])
        value, checksum = torch.stack([total.detach(), gradient.sum()]).tolist()  # one wait for the device
        return (value if math.isfinite(value) and math.isfinite(checksum) else math.inf), gradient

    here = state.pack()
    value, gradient = evaluate(here)
    values = [value]
    taken = 0
    while taken < steps and math.isfinite(value):
        way = curvature.descent(gradient)
        slope = float(way @ gradient)
        if slope >= 0:
            curvature.forget()
            way = curvature.descent(gradient)
            slope = float(way @ gradient)
        if slope > -_FLAT * max(1.0, abs(value)):
            break
        found = _backtrack(evaluate, here, way, value, slope)
        if found is None:
            break
        there, next_value, next_gradient = found
        curvature.learn(there - here, next_gradient - gradient)
        here, value, gradient = there, next_value, next_gradient
        values.append(value)
        taken += 1
        if len(values) > _PATIENCE and values[-1 - _PATIENCE] - value < settings.tolerance * abs(value):
            break
    state.load(here)
    return Block(values[0], value, spent, taken)


def _backtrack(
    evaluate: Callable[[Tensor], tuple[float, Tensor]], here: Tensor, way: Tensor, value: float, slope: float
) -> tuple[Tensor, float, Tensor] | None:
    """Shorten the step until the Armijo condition holds: parameters, value and gradient, or None."""
    length = 1.0
    for _ in range(_TRIALS):
        there = here + length * way
        next_value, gradient = evaluate(there)
        if next_value <= value + _ARMIJO * length * slope:
            return there, next_value, gradient
        # Minimum of the parabola through both values and the slope, clamped to 0.1-0.5 of the step.
        excess = next_value - value - length * slope
        guess = -slope * length * length / (2 * excess) if 0 < excess < math.inf else 0.0
        length = min(max(guess, 0.1 * length), 0.5 * length) if excess < math.inf else 0.25 * length
    return None


class _Curvature:
    """Pairs of steps and gradient changes, and the quasi-Newton direction from them.

    Compact form of Byrd, Nocedal and Schnabel (1994): a few matrix products with all pairs at once. In float64, since
    the small matrices are nearly singular at the end.
    """

    def __init__(self) -> None:
        self._steps: list[Tensor] = []
        self._changes: list[Tensor] = []

    def forget(self) -> None:
        self._steps, self._changes = [], []

    def learn(self, step: Tensor, change: Tensor) -> None:
        """Keep a pair, unless its curvature is negative."""
        s, y = step.double(), change.double()
        bend, most = torch.stack([s @ y, s.norm() * y.norm()]).tolist()
        if bend > _BEND * most:
            self._steps = [*self._steps[1 - _HISTORY :], s]
            self._changes = [*self._changes[1 - _HISTORY :], y]

    def descent(self, gradient: Tensor) -> Tensor:
        """Quasi-Newton step for a gradient (n,): (n,)."""
        g = gradient.double()
        if not self._steps:
            return -gradient * min(1.0, _FIRST / max(float(g.norm()), 1e-30))
        S, Y = torch.stack(self._steps), torch.stack(self._changes)
        sy, yy = S @ Y.T, Y @ Y.T
        gamma = sy[-1, -1] / yy[-1, -1]
        R = sy.triu()
        u = torch.linalg.solve_triangular(R, (S @ g)[:, None], upper=True)
        middle = sy.diagonal()[:, None] * u + gamma * (yy @ u - (Y @ g)[:, None])
        v = torch.linalg.solve_triangular(R.T, middle, upper=False)
        way: Tensor = gamma * (Y.T @ u[:, 0] - g) - S.T @ v[:, 0]
        return way.to(gradient.dtype)


def _adam_block(energy: Energy, settings: AdamSettings, steps: int, memory: Memory) -> Block:
    """Adam steps on one view. Its moments are kept over refreshes, and steps may raise the energy.

    People with non-finite gradients return to the previous step and are kept there until the next view.
    """
    state = energy.state
    parameters = state.parameters()
    if memory.adam is None:
        memory.adam = torch.optim.Adam(parameters, lr=settings.learning_rate)
    optimiser = memory.adam
    held: Tensor | None = None
    good = state.pack()
    totals: list[float] = []
    for _ in range(steps):
        total, broken = _differentiate(energy, parameters)
        if bool(broken.any()):
            state.put(good, broken)
            held = broken if held is None else held | broken
            total, broken = _differentiate(energy, parameters)
            if bool(broken.any()):
                break
        totals.append(total)
        good = state.pack()
        optimiser.step()
        if held is not None:
            state.put(good, held)
    total, broken = _differentiate(energy, parameters)
    if bool(broken.any()):
        state.put(good, broken)
    return Block(totals[0] if totals else total, total, len(totals) + 1, len(totals))


def _differentiate(energy: Energy, parameters: list[Tensor]) -> tuple[float, Tensor]:
    """Compute the gradients. Returns the energy, and (B,) bool: people with non-finite energy or gradients."""
    energies = energy()
    total = total_of(energies)
    gradients = torch.autograd.grad(total, parameters, allow_unused=True)
    broken = ~torch.isfinite(per_person(energies))
    for p, gradient in zip(parameters, gradients, strict=True):
        p.grad = torch.zeros_like(p) if gradient is None else gradient
        # The scale is shared: a non-finite gradient of it stops all people.
        fine = torch.isfinite(p.grad)
        broken = broken | ~(fine.reshape(len(p), -1).all(1) if p.ndim else fine | broken.any())
    return float(total.detach()), broken
