"""Minimisation of an energy: L-BFGS with a backtracking line search, or Adam.

Both update visibility every few steps and reject non-finite steps. No person's energy is higher at the end than at the
start (:mod:`physic_core.engine.joint.acceptance`). The first steps of Adam can lose a start that is nearly optimal: it
is then repeated with a tenth of the learning rate, at most twice. The scene's scale couples all people, so one L-BFGS
optimises them all. A separate curvature for each person and for the scale took twice as long and stopped centimetres
from the minimum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physic_core.engine.joint.acceptance import Energy, energy_per_person, revert_if_worse, term_totals, total_energy
from physic_core.engine.joint.settings import AdamSettings, LbfgsSettings

__all__ = ["MinimisationResult", "join_results", "minimise"]

_HISTORY_SIZE = 40  # pairs of L-BFGS; vectors of some hundred numbers are cheap compared with one evaluation
_FIRST_STEP = 0.5  # maximum length of the first step, in units of the state
_ARMIJO = 1e-4  # share of the predicted decrease that a step must reach
_MAX_TRIALS = 10  # step lengths that a line search tries
_MIN_CURVATURE = 1e-8  # cosine between a step and its change of the gradient
_MIN_SLOPE = 1e-9  # share of the energy; a smaller slope is below the resolution of float32
_RATE_CUTS = 2  # Adam: restarts with a tenth of the learning rate, for people whose energy has only increased
_PATIENCE = 5  # steps that together have to lower the energy by the tolerance


@dataclass(frozen=True)
class MinimisationResult:
    """Result of a minimisation; the state itself is changed in place.

    Attributes:
        start: term -> weighted energy at the start, under the visibility at the end.
        end: term -> weighted energy at the end.
        evaluations: number of evaluations of energy and gradient.
        steps: number of steps of the optimiser.
        totals: the energy after each refresh and at the end; a refresh may change the energy.
    """

    start: Mapping[str, float]
    end: Mapping[str, float]
    evaluations: int
    steps: int
    totals: tuple[float, ...]


def minimise(
    energy: Energy,
    settings: LbfgsSettings | AdamSettings,
    progress: Callable[[float], None] | None = None,
    groups: Tensor | None = None,
) -> MinimisationResult:
    """Minimise an energy by changing its state in place.

    Args:
        energy: refreshed, and finite at its present state.
        settings: their type selects the optimiser.
        progress: called with the completed share of the steps, 0-1.
        groups: (B,) int64 of people who touch each other; the end is kept or reverted for all people of a group.
    """
    origin = energy.state.pack()
    result = _minimise_once(energy, settings, progress, groups)
    for _ in range(_RATE_CUTS):
        if not isinstance(settings, AdamSettings) or not energy.state.parameters():
            break
        if bool(energy.state.people_changed(origin).all()):
            break
        settings = replace(settings, learning_rate=settings.learning_rate / 10)
        result = join_results(energy, origin, result, _minimise_once(energy, settings, None, groups))
    return result


@torch.no_grad()
def join_results(
    energy: Energy, origin: Tensor, first: MinimisationResult, second: MinimisationResult
) -> MinimisationResult:
    """Merge the results of two minimisations in a row, of which the first started at ``origin``."""
    end = energy.state.pack()
    energy.state.load(origin)
    start = term_totals(energy())
    energy.state.load(end)
    return MinimisationResult(
        start,
        second.end,
        first.evaluations + second.evaluations,
        first.steps + second.steps,
        (*first.totals, *second.totals),
    )


def _minimise_once(
    energy: Energy,
    settings: LbfgsSettings | AdamSettings,
    progress: Callable[[float], None] | None,
    groups: Tensor | None,
) -> MinimisationResult:
    """Take all steps of the settings, then revert the people whose energy has increased."""
    state = energy.state
    origin = state.pack()
    memory = _OptimiserMemory()
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
        if isinstance(settings, LbfgsSettings):
            converged = block.before - block.after < settings.tolerance * abs(block.before)
        if converged:
            break
    if not converged:  # else the motion since the last update is too small to change visibility
        energy.refresh()
    start, end = revert_if_worse(energy, state.pack(), origin, groups)
    totals.append(math.fsum(end.values()))
    if progress is not None:
        progress(1.0)
    return MinimisationResult(start, end, evaluations, taken, tuple(totals))


@dataclass(frozen=True)
class _Block:
    """Result of the steps between two refreshes: energy before and after, number of evaluations and steps."""

    before: float
    after: float
    evaluations: int
    steps: int


class _OptimiserMemory:
    """State of the optimiser that is kept over refreshes."""

    def __init__(self) -> None:
        self.history = LbfgsHistory()
        self.adam: torch.optim.Adam | None = None


def _lbfgs_block(energy: Energy, settings: LbfgsSettings, steps: int, memory: _OptimiserMemory) -> _Block:
    """Take L-BFGS steps between two refreshes; the history is kept, since the next energy is nearly equal."""
    state = energy.state
    parameters = state.parameters()
    history = memory.history
    evaluations = 0

    def evaluate(at: Tensor) -> tuple[float, Tensor]:
        nonlocal evaluations
        evaluations += 1
        state.load(at)
        total = total_energy(energy())
        gradients = torch.autograd.grad(total, parameters, allow_unused=True)
        flat = [torch.zeros_like(p) if g is None else g for p, g in zip(parameters, gradients, strict=True)]
        gradient = torch.cat([g.reshape(-1) for g in flat])
        value, checksum = torch.stack([total.detach(), gradient.sum()]).tolist()  # one synchronisation with the device
        return (value if math.isfinite(value) and math.isfinite(checksum) else math.inf), gradient

    here = state.pack()
    value, gradient = evaluate(here)
    values = [value]
    taken = 0
    while taken < steps and math.isfinite(value):
        direction = history.direction(gradient)
        slope = float(direction @ gradient)
        if slope >= 0:
            history.clear()
            direction = history.direction(gradient)
            slope = float(direction @ gradient)
        if slope > -_MIN_SLOPE * max(1.0, abs(value)):
            break
        found = _backtrack(evaluate, here, direction, value, slope)
        if found is None:
            break
        there, next_value, next_gradient = found
        history.add(there - here, next_gradient - gradient)
        here, value, gradient = there, next_value, next_gradient
        values.append(value)
        taken += 1
        if len(values) > _PATIENCE and values[-1 - _PATIENCE] - value < settings.tolerance * abs(value):
            break
    state.load(here)
    return _Block(values[0], value, evaluations, taken)


def _backtrack(
    evaluate: Callable[[Tensor], tuple[float, Tensor]], here: Tensor, direction: Tensor, value: float, slope: float
) -> tuple[Tensor, float, Tensor] | None:
    """Shorten the step until the Armijo condition holds; return parameters, value and gradient, or None."""
    length = 1.0
    for _ in range(_MAX_TRIALS):
        there = here + length * direction
        next_value, gradient = evaluate(there)
        if next_value <= value + _ARMIJO * length * slope:
            return there, next_value, gradient
        # Minimum of the parabola through both values and the slope, clamped to 0.1-0.5 of the step.
        excess = next_value - value - length * slope
        guess = -slope * length * length / (2 * excess) if 0 < excess < math.inf else 0.0
        length = min(max(guess, 0.1 * length), 0.5 * length) if excess < math.inf else 0.25 * length
    return None


class LbfgsHistory:
    """Pairs of steps and gradient changes, which define the quasi-Newton direction of L-BFGS.

    Compact form of Byrd, Nocedal and Schnabel (1994): a few matrix products with all pairs. In float64, since the
    small matrices are nearly singular at the end.
    """

    def __init__(self) -> None:
        self._steps: list[Tensor] = []
        self._changes: list[Tensor] = []

    def clear(self) -> None:
        """Remove all pairs."""
        self._steps, self._changes = [], []

    def add(self, step: Tensor, change: Tensor) -> None:
        """Add a pair, unless its curvature is negative."""
        s, y = step.double(), change.double()
        curvature, bound = torch.stack([s @ y, s.norm() * y.norm()]).tolist()
        if curvature > _MIN_CURVATURE * bound:
            self._steps = [*self._steps[1 - _HISTORY_SIZE :], s]
            self._changes = [*self._changes[1 - _HISTORY_SIZE :], y]

    def direction(self, gradient: Tensor) -> Tensor:
        """Return the quasi-Newton step (n,) for a gradient (n,)."""
        g = gradient.double()
        if not self._steps:
            return -gradient * min(1.0, _FIRST_STEP / max(float(g.norm()), 1e-30))
        S, Y = torch.stack(self._steps), torch.stack(self._changes)
        sy, yy = S @ Y.T, Y @ Y.T
        gamma = sy[-1, -1] / yy[-1, -1]
        R = sy.triu()
        u = torch.linalg.solve_triangular(R, (S @ g)[:, None], upper=True)
        middle = sy.diagonal()[:, None] * u + gamma * (yy @ u - (Y @ g)[:, None])
        v = torch.linalg.solve_triangular(R.T, middle, upper=False)
        step: Tensor = gamma * (Y.T @ u[:, 0] - g) - S.T @ v[:, 0]
        return step.to(gradient.dtype)


def _adam_block(energy: Energy, settings: AdamSettings, steps: int, memory: _OptimiserMemory) -> _Block:
    """Take Adam steps between two refreshes. Its moments are kept over refreshes, and steps may raise the energy.

    People with non-finite gradients return to the previous step and are kept there until the next refresh.
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
    return _Block(totals[0] if totals else total, total, len(totals) + 1, len(totals))


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
