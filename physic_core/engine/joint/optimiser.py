"""Minimisation of an energy: L-BFGS with a backtracking line search.

Visibility is updated every few steps, and non-finite steps are rejected. No person's energy is higher at the end than
at the start (:mod:`physic_core.engine.joint.acceptance`). Each person has a separate curvature, which includes the
scale of the scene that couples all people.
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
class BlockResult:
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
    """Merge the results of two consecutive minimisations; the first started at ``origin``."""
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
    def start(self, energy: Energy, groups: Tensor | None = None) -> Callable[[int], BlockResult]:
        """Return a function that takes at most a number of steps without an update.

        Args:
            energy: to minimise.
            groups: see :meth:`minimise`.
        """

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
        origin, take_steps = state.pack(), self.start(energy, groups)
        done, blocks = 0, list[BlockResult]()
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

    def start(self, energy: Energy, groups: Tensor | None = None) -> Callable[[int], BlockResult]:
        """Return a function that takes steps. The history is kept across updates: the next energy is nearly equal."""
        return partial(_lbfgs_block, energy, self.tolerance, LbfgsHistory(groups))


@dataclass(frozen=True)
class Gradient:
    """Gradient of the energy of B people with D parameters each, and of the scale that they share.

    Attributes:
        people: (B, D).
        scale: (B,) of each person's energy by the scale; None if the scale is not free. Contributions that do not
            belong to one person are shared equally.
    """

    people: Tensor
    scale: Tensor | None


@dataclass(frozen=True)
class _Point:
    """A state, its energy and gradient."""

    at: Tensor
    value: float
    gradient: Tensor
    of_people: Gradient


def _evaluate(energy: Energy, at: Tensor) -> _Point:
    """Return the energy and its gradient at a state; the energy is inf if either is not finite."""
    state = energy.state
    state.load(at)
    total = total_energy(energy())
    wanted = [*state.parameters(), state.scale_shares]
    gradients = torch.autograd.grad(total, wanted, allow_unused=True)
    flat = [torch.zeros_like(p) if g is None else g for p, g in zip(wanted, gradients, strict=True)]
    gradient = torch.cat([g.reshape(-1) for g in flat[:-1]])
    value, checksum = torch.stack([total.detach(), gradient.sum()]).tolist()  # one synchronisation with the device
    people, scale = state.split(gradient)
    if scale is not None:
        scale = flat[-1] + (scale - flat[-1].sum()) / len(people)
    finite = math.isfinite(value) and math.isfinite(checksum)
    return _Point(at, value if finite else math.inf, gradient, Gradient(people, scale))


def _lbfgs_block(energy: Energy, tolerance: float, history: LbfgsHistory, steps: int) -> BlockResult:
    """Take L-BFGS steps between two refreshes."""
    state = energy.state
    evaluations = 0

    def evaluate(at: Tensor) -> _Point:
        nonlocal evaluations
        evaluations += 1
        return _evaluate(energy, at)

    here = evaluate(state.pack())
    values = [here.value]
    taken = 0
    while taken < steps and math.isfinite(here.value):
        direction = state.merge(*history.direction(here.of_people))
        slope = float(direction @ here.gradient)
        if slope >= 0:
            history.clear()
            direction = state.merge(*history.direction(here.of_people))
            slope = float(direction @ here.gradient)
        if slope > -_MIN_SLOPE * max(1.0, abs(here.value)):
            break
        found = _backtrack(evaluate, here, direction, slope)
        if found is None:
            break
        history.add(*state.split(found.at - here.at), here.of_people, found.of_people)
        here = found
        values.append(here.value)
        taken += 1
        if len(values) > _PATIENCE and values[-1 - _PATIENCE] - here.value < tolerance * abs(here.value):
            break
    state.load(here.at)
    converged = values[0] - here.value < tolerance * abs(values[0])
    return BlockResult(evaluations, taken, converged)


def _backtrack(evaluate: Callable[[Tensor], _Point], here: _Point, direction: Tensor, slope: float) -> _Point | None:
    """Shorten the step until the Armijo condition holds; return the point found, or None."""
    length = 1.0
    for _ in range(_MAX_TRIALS):
        there = evaluate(here.at + length * direction)
        if there.value <= here.value + _ARMIJO * length * slope:
            return there
        # Minimum of the parabola through both values and the slope, clamped to 0.1-0.5 of the step.
        excess = there.value - here.value - length * slope
        guess = -slope * length * length / (2 * excess) if 0 < excess < math.inf else 0.0
        length = min(max(guess, 0.1 * length), 0.5 * length) if excess < math.inf else 0.25 * length
    return None


class LbfgsHistory:
    """Steps and gradient changes, which define the quasi-Newton direction of L-BFGS for people who share a scale.

    The energy is a sum over people, each a function of the person's own parameters and of the scale. Each person has a
    separate history (Griewank and Toint 1982: partially separable functions), so that several people need no more
    steps than one. Their Newton equations are joined by the scale, which is eliminated. With the inverse Hessian of
    person i split into (P_i, q_i; q_i', r_i), the last row being the scale's, and the gradient into g_i and h_i:

        step of the scale = -(sum_i h_i + q_i' g_i / r_i) / sum_i 1 / r_i
        step of person i  = -P_i g_i + q_i (q_i' g_i + step of the scale) / r_i

    Each inverse Hessian is applied in the compact form of Byrd, Nocedal and Schnabel (1994): a few matrix products with
    all pairs. In float64, since the small matrices are nearly singular at the end.

    Args:
        groups: (B,) int64, the same for people who touch each other, who share one history; None if all are separate.
    """

    def __init__(self, groups: Tensor | None = None) -> None:
        self._groups = groups
        self.clear()

    def clear(self) -> None:
        """Remove all pairs."""
        self._pairs: list[_Pair] = []
        self._gamma: Tensor | None = None

    def add(self, step: Tensor, scale_step: Tensor | None, before: Gradient, after: Gradient) -> None:
        """Add the step (B, D) of people and that () of the scale, except for people whose curvature is negative."""
        s, y = step.double(), (after.people - before.people).double()
        t, z = s.new_zeros(len(s)), s.new_zeros(len(s))
        if scale_step is not None and before.scale is not None and after.scale is not None:
            t, z = t + scale_step.double(), self._by_group((after.scale - before.scale).double())
        sy, ss, yy = (self._by_group((a * b).sum(1)) for a, b in ((s, y), (s, s), (y, y)))
        curvature, length = sy + t * z, yy + z * z
        kept = curvature > _MIN_CURVATURE * ((ss + t * t) * length).sqrt()
        if self._gamma is not None:
            self._gamma = torch.where(kept, curvature / length, self._gamma)
        rows = kept if self._groups is None else kept[self._groups]
        s, y = torch.where(rows[:, None], s, 0.0), torch.where(rows[:, None], y, 0.0)
        pair = _Pair(s, y, torch.where(kept, t, 0.0), torch.where(kept, z, 0.0), kept)
        self._pairs = [*self._pairs[1 - _HISTORY_SIZE :], pair]

    def direction(self, gradient: Gradient) -> tuple[Tensor, Tensor | None]:
        """Return the quasi-Newton step of people (B, D) and of the scale ()."""
        g, h = gradient.people.double(), gradient.scale
        total = g.square().sum() if h is None else g.square().sum() + h.double().sum().square()
        if self._gamma is None:
            self._gamma = (_FIRST_STEP / total.sqrt().clamp(min=1e-30)).clamp(max=1.0).expand(len(g))
        none = g.new_zeros(len(g))
        if h is None:
            step, _ = self._apply_inverse(g[..., None], none[:, None])
            return -step[..., 0].to(gradient.people), None
        ones = torch.ones_like(none)
        P, q = self._apply_inverse(torch.stack([g, torch.zeros_like(g)], 2), torch.stack([none, ones], 1))
        along, r = q.unbind(1)
        present = ones if self._groups is None else self._by_group(ones).clamp(max=1.0)
        scale = -(h.double().sum() + (present * along / r).sum()) / (present / r).sum()
        factor = (along + scale) / r
        step = P[..., 1] * (factor if self._groups is None else factor[self._groups])[:, None] - P[..., 0]
        return step.to(gradient.people), scale.to(h)

    def _by_group(self, of_people: Tensor) -> Tensor:
        """Sum numbers (B, ...) of people over their groups: (B, ...), 0 for indices that are no group."""
        return of_people if self._groups is None else torch.zeros_like(of_people).index_add(0, self._groups, of_people)

    def _apply_inverse(self, people: Tensor, scale: Tensor) -> tuple[Tensor, Tensor]:
        """Multiply the inverse Hessian of each group by columns: (B, D, c) of people and (B, c) of the scale."""
        gamma = self._gamma
        assert gamma is not None
        own = slice(None) if self._groups is None else self._groups
        if not self._pairs:
            return gamma[own, None, None] * people, gamma[:, None] * scale
        S, Y = (torch.stack([getattr(pair, name) for pair in self._pairs], 1) for name in ("step", "change"))
        s, y, kept = (
            torch.stack([getattr(pair, name) for pair in self._pairs], 1)
            for name in ("scale_step", "scale_change", "kept")
        )
        sy = self._by_group(S @ Y.mT) + s[:, :, None] * y[:, None]
        yy = self._by_group(Y @ Y.mT) + y[:, :, None] * y[:, None]
        R = sy.triu() + torch.diag_embed((~kept).to(sy))
        by_step = self._by_group(S @ people) + s[:, :, None] * scale[:, None]
        by_change = self._by_group(Y @ people) + y[:, :, None] * scale[:, None]
        u = torch.linalg.solve_triangular(R, by_step, upper=True)
        factor = gamma[:, None, None]
        middle = sy.diagonal(dim1=1, dim2=2)[..., None] * u + factor * (yy @ u - by_change)
        v = torch.linalg.solve_triangular(R.mT, middle, upper=False)
        found = factor[own] * (people - Y.mT @ u[own]) + S.mT @ v[own]
        of_scale = factor[:, 0] * (scale - (y[:, None] @ u)[:, 0]) + (s[:, None] @ v)[:, 0]
        return found, of_scale


@dataclass(frozen=True)
class _Pair:
    """A step and the change of the gradient: (B, D) of people, (B,) of the scale by group; 0 where it is not kept."""

    step: Tensor
    change: Tensor
    scale_step: Tensor
    scale_change: Tensor
    kept: Tensor
