"""Minimisation of an energy: L-BFGS with a backtracking line search.

Visibility is updated every few steps, and non-finite steps are rejected. No person's energy is higher at the end than
at the start (:mod:`physic_core.engine.joint.acceptance`). The scene's scale couples all people, so one L-BFGS optimises
them all. A separate curvature for each person and for the scale took twice as long and stopped centimetres from the
minimum.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from physic_core.engine.joint.acceptance import Energy, revert_if_worse, term_totals, total_energy
from physic_core.types.bounds import Count, NotNegative, PositiveCount

StepProgress = Callable[[float], None]
"""Called with the completed share of the work, 0-1."""

_HISTORY_SIZE = 40  # pairs of L-BFGS; vectors of some hundred numbers are cheap compared with one evaluation
_FIRST_STEP = 0.5  # maximum length of the first step, in units of the state
_ARMIJO = 1e-4  # share of the predicted decrease that a step must reach
_MAX_TRIALS = 10  # step lengths that a line search tries
_MIN_CURVATURE = 1e-8  # cosine between a step and its change of the gradient
_MIN_SLOPE = 1e-9  # share of the energy; a smaller slope is below the resolution of float32
_PATIENCE = 5  # steps that together have to lower the energy by the tolerance


@dataclass(frozen=True)
class MinimisationResult:
    """Result of a minimisation; the state itself is changed in place.

    Attributes:
        start: term -> weighted energy at the start, under the visibility at the end.
        end: term -> weighted energy at the end.
        evaluations: number of evaluations of energy and gradient.
        steps: number of steps of the optimiser.
    """

    start: Mapping[str, float]
    end: Mapping[str, float]
    evaluations: int
    steps: int


@dataclass(frozen=True)
class Block:
    """Result of the steps between two refreshes.

    Attributes:
        evaluations: number of evaluations of energy and gradient.
        steps: number of steps that were taken.
        converged: whether further steps would change little.
    """

    evaluations: int
    steps: int
    converged: bool = False


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
    )


@dataclass(frozen=True)
class OptimiserSettings(ABC):
    """Settings of a minimiser that updates visibility after every block of steps."""

    steps: Count
    """At most."""
    refresh_steps: PositiveCount
    """Steps between two updates of visibility and nearest points."""

    @abstractmethod
    def start(self, energy: Energy) -> Callable[[int], Block]:
        """Return a function that takes at most a number of steps without an update."""

    def minimise(
        self, energy: Energy, progress: StepProgress | None = None, groups: Tensor | None = None
    ) -> MinimisationResult:
        """Minimise an energy by changing its state in place, then revert the people whose energy has increased.

        Args:
            energy: refreshed, and finite at its present state.
            progress: called with the completed share of the steps.
            groups: (B,) int64 of people who touch each other; the end is kept or reverted for all people of a group.
        """
        state = energy.state
        origin, take_steps = state.pack(), self.start(energy)
        done, blocks = 0, list[Block]()
        while done < self.steps and state.parameters() and not (blocks and blocks[-1].converged):
            if done:
                energy.refresh()
            steps = min(self.refresh_steps, self.steps - done)
            blocks.append(take_steps(steps))
            done += steps
            if progress is not None:
                progress(done / self.steps)
        if not (blocks and blocks[-1].converged):  # else the motion is too small to change visibility
            energy.refresh()
        start, end = revert_if_worse(energy, state.pack(), origin, groups)
        if progress is not None:
            progress(1.0)
        evaluations, taken = sum(block.evaluations for block in blocks), sum(block.steps for block in blocks)
        return MinimisationResult(start, end, evaluations, taken)


@dataclass(frozen=True)
class LbfgsSettings(OptimiserSettings):
    """Settings of L-BFGS with a backtracking (Armijo) line search."""

    steps: Count = 80
    """At most; 40-100."""
    refresh_steps: PositiveCount = 20
    """Steps between two updates of visibility and nearest points; 10-30."""
    tolerance: NotNegative = 5e-3
    """Stop when the steps between two updates lower the energy by less than this share; 0 never stops."""

    def start(self, energy: Energy) -> Callable[[int], Block]:
        """Return a function that takes steps. The history is kept over updates: the next energy is nearly equal."""
        return partial(_lbfgs_block, energy, self.tolerance, LbfgsHistory())


def _lbfgs_block(energy: Energy, tolerance: float, history: LbfgsHistory, steps: int) -> Block:
    """Take L-BFGS steps between two refreshes."""
    state = energy.state
    parameters = state.parameters()
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
        if len(values) > _PATIENCE and values[-1 - _PATIENCE] - value < tolerance * abs(value):
            break
    state.load(here)
    converged = values[0] - value < tolerance * abs(values[0])
    return Block(evaluations, taken, converged)


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
