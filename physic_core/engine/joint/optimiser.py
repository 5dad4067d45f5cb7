"""Minimise the joint energy, and keep the better state of each person: no energy ends higher than
it started.

All people share the scene's scale, so a person's energies in two states are comparable only at one
scale. For the scale of each state, every person takes the state with their lower energy. The scale
with the lowest total is kept. Only people who did not improve return to their start. The start is
one of the candidates, so the total never increases.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, Protocol, TypeAlias

import torch
from torch import Tensor

from physic_core.engine.joint.variables import Variables
from physic_core.types.bounds import Count, NotNegative, PositiveCount

_SCENE_TERM = "scale"  # the term of the scene, not of a person


class EnergyTerms(Protocol):
    """Energy as a function of its state, for a minimiser that changes the state."""

    variables: Variables

    def __call__(self) -> Mapping[str, Tensor]:
        """Return the weighted terms at the current state: (B,) each, "scale" is (1,);
        differentiable.
        """

    def refresh(self) -> None:
        """Update visibility and nearest points to the current state."""


def total_energy(energies: Mapping[str, Tensor]) -> Tensor:
    """Return the sum of all terms: ()."""
    return torch.cat(tuple(energies.values())).sum()


def energy_per_person(energies: Mapping[str, Tensor]) -> Tensor:
    """Return the sum of each person's terms: (B,). The term of the scene is skipped."""
    return torch.stack([value for name, value in energies.items() if name != _SCENE_TERM]).sum(0)


def finite_energy_per_person(
    energies: Mapping[str, Tensor], groups: Tensor | None = None
) -> Tensor:
    """Return the energy of each person: (B,); inf if not finite.

    Args:
        energies: (B,) each.
        groups: (B,) int64, people of one group get the sum of their energies; None if all people
            are separate.
    """
    own = energy_per_person(energies)
    own = torch.where(torch.isfinite(own), own, torch.inf)
    return own if groups is None else torch.zeros_like(own).index_add(0, groups, own)[groups]


def term_totals(energies: Mapping[str, Tensor]) -> dict[str, float]:
    """Return the sum of each term over all people: term name -> energy."""
    sums = torch.stack([value.detach().sum() for value in energies.values()])
    return dict(zip(energies, sums.tolist(), strict=True))


@torch.no_grad()
def revert_if_worse(
    energy: EnergyTerms, end: Tensor, start: Tensor, groups: Tensor | None = None
) -> tuple[dict[str, float], dict[str, float]]:
    """Keep the end state of each person, or restore the start state of a person whose energy is
    lower at the start.

    Args:
        energy: its visibility is that of the end.
        end: packed state.
        start: packed state.
        groups: (B,) int64 of people who touch each other, and are restored together; None if all
            people are separate.

    Returns:
        Each term at the start and at the accepted state, both under the visibility of ``end``.
    """
    variables = energy.variables
    variables.load(start)
    before = energy()
    variables.load(end)
    after = energy()
    better = finite_energy_per_person(after, groups) <= finite_energy_per_person(before, groups)
    if not better.all() or not _finite_total(after) <= _finite_total(before):
        keep_lowest_energy(energy, (end, start), groups=groups)
        after = energy()
        if not _finite_total(after) <= _finite_total(before):
            # Terms between people depend on the other people's states.
            variables.load(start)
            after = before
        if not torch.equal(variables.pack(), end):
            energy.refresh()
    return term_totals(before), term_totals(after)


@torch.no_grad()
def keep_lowest_energy(
    energy: EnergyTerms, states: Sequence[Tensor], *, groups: Tensor | None = None
) -> None:
    """Set each person to the state of lowest energy, and the scene to the scale with the lowest
    total energy.

    Args:
        energy: its state is changed.
        states: packed, at least one.
        groups: (B,) int64, see :func:`revert_if_worse`.
    """
    variables = energy.variables
    parts = [variables.split(state) for state in states]
    best = (math.inf, math.inf)
    chosen = states[0]
    for _, scale in parts:
        mixed = parts[0][0]
        lowest = mixed.new_full((len(mixed),), torch.inf)
        of_scene = 0.0
        for people, _ in parts:
            variables.load(variables.merge(people, scale))
            energies = energy()
            if _SCENE_TERM in energies:
                of_scene = float(energies[_SCENE_TERM].sum())
            person_energy = finite_energy_per_person(energies, groups)
            mixed = torch.where((person_energy < lowest)[:, None], people, mixed)
            lowest = torch.minimum(person_energy, lowest)
        # A person with non-finite energy in all states is excluded from the totals.
        finite = torch.isfinite(lowest)
        value = (float((~finite).sum()), float(lowest[finite].sum()) + of_scene)
        if value < best:
            best = value
            chosen = variables.merge(mixed, scale)
    variables.load(chosen)


def _finite_total(energies: Mapping[str, Tensor]) -> float:
    """Return the total energy; inf if it is not finite."""
    total = float(total_energy(energies))
    return total if math.isfinite(total) else math.inf


StepProgress = Callable[[float], None]
"""Called with the completed share of the work, 0-1."""


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
    energy: EnergyTerms, origin: Tensor, first: MinimisationResult, second: MinimisationResult
) -> MinimisationResult:
    """Merge the results of two consecutive minimisations; the first started at ``origin``."""
    end = energy.variables.pack()
    energy.variables.load(origin)
    start = term_totals(energy())
    energy.variables.load(end)
    return MinimisationResult(
        start,
        second.end,
        first.evaluations + second.evaluations,
        first.steps + second.steps,
    )


class Optimiser(ABC):
    """Minimiser that updates visibility after every block of steps; a subclass is a frozen
    dataclass of its settings.

    Attributes:
        steps: at most.
        refresh_steps: steps between two updates of visibility and nearest points.
    """

    steps: int
    refresh_steps: int

    @abstractmethod
    def start(
        self, energy: EnergyTerms, groups: Tensor | None = None
    ) -> Callable[[int], BlockResult]:
        """Return a function that takes at most a number of steps without an update.

        Args:
            energy: to minimise.
            groups: see :meth:`minimise`.
        """

    def minimise(
        self,
        energy: EnergyTerms,
        progress: StepProgress | None = None,
        groups: Tensor | None = None,
    ) -> MinimisationResult:
        """Minimise an energy by changing its state in place, then revert the people whose energy
        has increased.

        Args:
            energy: refreshed, and finite at its present state.
            progress: called with the completed share of the steps.
            groups: (B,) int64 of people who touch each other; the end is kept or reverted for all
                people of a group.
        """
        variables = energy.variables
        origin = variables.pack()
        take_steps = self.start(energy, groups)
        done = evaluations = taken = 0
        converged = False
        while done < self.steps and variables.parameters() and not converged:
            if done:
                energy.refresh()
            block = take_steps(min(self.refresh_steps, self.steps - done))
            done = min(done + self.refresh_steps, self.steps)
            evaluations += block.evaluations
            taken += block.steps
            converged = block.converged
            if progress is not None:
                progress(done / self.steps)
        # else the motion is too small to change visibility
        if not converged:
            energy.refresh()
        start, end = revert_if_worse(energy, variables.pack(), origin, groups)
        if progress is not None:
            progress(1.0)
        return MinimisationResult(start, end, evaluations, taken)


@dataclass(frozen=True)
class LbfgsOptimiser(Optimiser):
    """L-BFGS with a backtracking (Armijo) line search."""

    steps: Count = 80
    """At most; 40-100."""
    refresh_steps: PositiveCount = 20
    """Steps between two updates of visibility and nearest points; 10-30."""
    tolerance: NotNegative = 5e-3
    """Stop when the steps between two updates lower the energy by less than this share; 0 never
    stops.
    """

    def start(
        self, energy: EnergyTerms, groups: Tensor | None = None
    ) -> Callable[[int], BlockResult]:
        """Return the function that takes the next step.

        The history is kept across updates: the next energy is nearly equal.
        """
        return partial(_lbfgs_block, energy, self.tolerance, LbfgsHistory(groups))


Gradient: TypeAlias = tuple[Tensor, Tensor | None]
"""Gradient (B, D) of the energy of B people by their D parameters, and (B,) of each person's energy
by the scale that they share; None if the scale is not free.

Contributions that do not belong to one person are shared equally.
"""


@dataclass(frozen=True)
class _Point:
    """A state, its energy and gradient."""

    at: Tensor
    value: float
    gradient: Tensor
    of_people: Gradient


def _evaluate(energy: EnergyTerms, packed: Tensor) -> _Point:
    """Return the energy and its gradient at a state; the energy is inf if either is not finite."""
    variables = energy.variables
    variables.load(packed)
    total = total_energy(energy())
    wanted = [*variables.parameters(), variables.scale_shares]
    gradients = torch.autograd.grad(total, wanted, allow_unused=True)
    flat = [torch.zeros_like(p) if g is None else g for p, g in zip(wanted, gradients, strict=True)]
    gradient = torch.cat([g.reshape(-1) for g in flat[:-1]])
    value, checksum = torch.stack([total.detach(), gradient.sum()]).tolist()
    people, scale = variables.split(gradient)
    if scale is not None:
        scale = flat[-1] + (scale - flat[-1].sum()) / len(people)
    finite = math.isfinite(value) and math.isfinite(checksum)
    return _Point(packed, value if finite else math.inf, gradient, (people, scale))


_MIN_SLOPE = 1e-9  # share of the energy; a smaller slope is below the resolution of float32
_PATIENCE = 5  # steps that together have to lower the energy by the tolerance


def _lbfgs_block(
    energy: EnergyTerms, tolerance: float, history: LbfgsHistory, steps: int
) -> BlockResult:
    """Take L-BFGS steps between two refreshes."""
    variables = energy.variables
    evaluations = 0

    def evaluate(packed: Tensor) -> _Point:
        nonlocal evaluations
        evaluations += 1
        return _evaluate(energy, packed)

    point = evaluate(variables.pack())
    values = [point.value]
    taken = 0
    while taken < steps and math.isfinite(point.value):
        direction = variables.merge(*history.direction(point.of_people))
        slope = float(direction @ point.gradient)
        if slope >= 0:
            history.clear()
            direction = variables.merge(*history.direction(point.of_people))
            slope = float(direction @ point.gradient)
        if slope > -_MIN_SLOPE * max(1.0, abs(point.value)):
            break
        next_point = _backtrack(evaluate, point, direction, slope)
        if next_point is None:
            break
        history.add(
            *variables.split(next_point.at - point.at), point.of_people, next_point.of_people
        )
        point = next_point
        values.append(point.value)
        taken += 1
        if len(values) > _PATIENCE and values[-1 - _PATIENCE] - point.value < tolerance * abs(
            point.value
        ):
            break
    variables.load(point.at)
    converged = values[0] - point.value < tolerance * abs(values[0])
    return BlockResult(evaluations, taken, converged)


_ARMIJO = 1e-4  # share of the predicted decrease that a step must reach
_MAX_TRIALS = 10  # step lengths that a line search tries


def _backtrack(
    evaluate: Callable[[Tensor], _Point], point: _Point, direction: Tensor, slope: float
) -> _Point | None:
    """Shorten the step until the Armijo condition holds; return the point found, or None."""
    length = 1.0
    for _ in range(_MAX_TRIALS):
        trial = evaluate(point.at + length * direction)
        if trial.value <= point.value + _ARMIJO * length * slope:
            return trial
        # Minimum of the parabola through both values and the slope, clamped to 0.1-0.5 of the step.
        excess = trial.value - point.value - length * slope
        guess = -slope * length * length / (2 * excess) if 0 < excess < math.inf else 0.0
        length = min(max(guess, 0.1 * length), 0.5 * length) if excess < math.inf else 0.25 * length
    return None


_HISTORY_SIZE = 40  # pairs of L-BFGS; vectors of some hundred numbers cost less than an evaluation
_FIRST_STEP = 0.5  # maximum length of the first step, in units of the state
_MIN_CURVATURE = 1e-8  # cosine between a step and its change of the gradient


class _Pair(NamedTuple):
    """A step of B people and its change of the gradient, float64; 0 where it is not kept."""

    step: Tensor
    """(B, D) of people."""
    change: Tensor
    """(B, D)."""
    scale_step: Tensor
    """(B,) of the scale, for each group."""
    scale_change: Tensor
    """(B,)."""
    is_usable: Tensor
    """(B,) bool, by group."""


class LbfgsHistory:
    """Steps and gradient changes, which define the quasi-Newton direction of L-BFGS for people who
    share a scale.

    The energy is a sum over people, each a function of the person's own parameters and of the
    scale. Each person has a separate history (Griewank and Toint 1982: partially separable
    functions), so that several people need no more steps than one. Their Newton equations are
    joined by the scale, which is eliminated. With the inverse Hessian of person i split into (P_i,
    q_i; q_i', r_i), the last row being the scale's, and the gradient into g_i and h_i:

        step of the scale = -(sum_i h_i + q_i' g_i / r_i) / sum_i 1 / r_i
        step of person i  = -P_i g_i + q_i (q_i' g_i + step of the scale) / r_i

    Each inverse Hessian is applied in the compact form of Byrd, Nocedal and Schnabel (1994): a few
    matrix products with all pairs. In float64, since the small matrices are nearly singular at the
    end.

    Args:
        groups: (B,) int64, the same for people who touch each other, who share one history; None if
            all are separate.
    """

    def __init__(self, groups: Tensor | None = None) -> None:
        self._groups = groups
        self.clear()

    def clear(self) -> None:
        """Remove all pairs."""
        self._pairs: list[_Pair] = []
        self._gamma: Tensor | None = None

    def add(
        self, step: Tensor, scale_step: Tensor | None, before: Gradient, after: Gradient
    ) -> None:
        """Add the step (B, D) of people and that () of the scale, except for people whose curvature
        is negative.
        """
        step = step.double()
        change = (after[0] - before[0]).double()
        step_of_scale = step.new_zeros(len(step))
        change_of_scale = step.new_zeros(len(step))
        if scale_step is not None and before[1] is not None and after[1] is not None:
            step_of_scale = step_of_scale + scale_step.double()
            change_of_scale = self._by_group((after[1] - before[1]).double())
        sy, ss, yy = (
            self._by_group((a * b).sum(1))
            for a, b in ((step, change), (step, step), (change, change))
        )
        curvature = sy + step_of_scale * change_of_scale
        length = yy + change_of_scale * change_of_scale
        is_usable = (
            curvature > _MIN_CURVATURE * ((ss + step_of_scale * step_of_scale) * length).sqrt()
        )
        if self._gamma is not None:
            self._gamma = torch.where(is_usable, curvature / length, self._gamma)
        rows = is_usable if self._groups is None else is_usable[self._groups]
        pair = _Pair(
            torch.where(rows[:, None], step, 0.0),
            torch.where(rows[:, None], change, 0.0),
            torch.where(is_usable, step_of_scale, 0.0),
            torch.where(is_usable, change_of_scale, 0.0),
            is_usable,
        )
        self._pairs = [*self._pairs[1 - _HISTORY_SIZE :], pair]

    def direction(self, gradient: Gradient) -> tuple[Tensor, Tensor | None]:
        """Return the quasi-Newton step of people (B, D) and of the scale ()."""
        people, h = gradient
        g = people.double()
        total = g.square().sum() if h is None else g.square().sum() + h.double().sum().square()
        if self._gamma is None:
            self._gamma = (
                (_FIRST_STEP / total.sqrt().clamp(min=1e-30)).clamp(max=1.0).expand(len(g))
            )
        none = g.new_zeros(len(g))
        if h is None:
            step, _ = self._apply_inverse(g[..., None], none[:, None])
            return -step[..., 0].to(people), None
        ones = torch.ones_like(none)
        P, q = self._apply_inverse(
            torch.stack([g, torch.zeros_like(g)], 2), torch.stack([none, ones], 1)
        )
        along, r = q.unbind(1)
        present = ones if self._groups is None else self._by_group(ones).clamp(max=1.0)
        scale = -(h.double().sum() + (present * along / r).sum()) / (present / r).sum()
        factor = (along + scale) / r
        step = (
            P[..., 1] * (factor if self._groups is None else factor[self._groups])[:, None]
            - P[..., 0]
        )
        return step.to(people), scale.to(h)

    def _by_group(self, of_people: Tensor) -> Tensor:
        """Sum numbers (B, ...) of people over their groups: (B, ...), 0 for indices without a
        group.
        """
        return (
            of_people
            if self._groups is None
            else torch.zeros_like(of_people).index_add(0, self._groups, of_people)
        )

    def _apply_inverse(self, people: Tensor, scale: Tensor) -> tuple[Tensor, Tensor]:
        """Multiply the inverse Hessian of each group by columns: (B, D, c) of people and (B, c) of
        the scale.
        """
        gamma = self._gamma
        assert gamma is not None
        groups = slice(None) if self._groups is None else self._groups
        if not self._pairs:
            return gamma[groups, None, None] * people, gamma[:, None] * scale
        # all pairs: (B, k, D) of people, (B, k) of the scale
        step, change, scale_step, scale_change, kept = (
            torch.stack(part, 1) for part in zip(*self._pairs, strict=True)
        )
        sy = self._by_group(step @ change.mT) + scale_step[:, :, None] * scale_change[:, None]
        yy = self._by_group(change @ change.mT) + scale_change[:, :, None] * scale_change[:, None]
        R = sy.triu() + torch.diag_embed((~kept).to(sy))
        by_step = self._by_group(step @ people) + scale_step[:, :, None] * scale[:, None]
        by_change = self._by_group(change @ people) + scale_change[:, :, None] * scale[:, None]
        u = torch.linalg.solve_triangular(R, by_step, upper=True)
        factor = gamma[:, None, None]
        middle = sy.diagonal(dim1=1, dim2=2)[..., None] * u + factor * (yy @ u - by_change)
        v = torch.linalg.solve_triangular(R.mT, middle, upper=False)
        of_people = factor[groups] * (people - change.mT @ u[groups]) + step.mT @ v[groups]
        of_scale = factor[:, 0] * (scale - (scale_change[:, None] @ u)[:, 0])
        return of_people, of_scale + (scale_step[:, None] @ v)[:, 0]
