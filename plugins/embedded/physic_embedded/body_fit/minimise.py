"""Minimise the losses of people by BFGS, each with their own step, curvature and stop.

People do not depend on each other. With one step and one curvature for all, they do: on the way to
a minimum, rounding errors are multiplied by a million, and a pose would follow who stands beside
it. The search has two parts. From the start, gradients alone choose the minimum. Near to it, the
search begins again with the Hessian, which gradients then keep up to date, and it converges: there
an error of the input moves the body by about as much.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch

from physic_embedded.body_fit.derivatives import derivatives, loss_and_gradient

if TYPE_CHECKING:
    from torch import Tensor

    from physic_embedded.body_fit.fit_problem import FitProblem

CONVERGED = 1e-7
"""Largest step of an unknown after which a person is done."""
_MAX_EVALUATIONS = 300
_STEPS_OF_HESSIAN = 14  # after which it is computed again: it costs as much as three to ten steps
_LEAST_CURVATURE = 0.01  # of the loss by an unknown
_TRIAL = 1e-3  # length of the step that tells the first curvature
_ARMIJO = 1e-4  # share of the predicted decrease that a step must reach
_ROUNDING = 1e-12  # share of the loss by which rounding may seem to raise it
_POSITIVE = 1e-8  # least cosine between a step and its change of the gradient

Derivatives = Callable[["FitProblem", "Tensor"], tuple["Tensor", "Tensor", "Tensor"]]


def approach_minimum(problem: FitProblem, start: Tensor, evaluations: int) -> Tensor:
    """Return the unknowns (N, W) after a number of evaluations from the start (N, W), each of which
    is a step unless it raises the person's loss.
    """
    loss, gradient = loss_and_gradient(problem, start)
    step = -gradient / gradient.norm(dim=1, keepdim=True).clamp(min=1.0)
    _, there = loss_and_gradient(problem, start + _TRIAL * step)
    change = (there - gradient) / _TRIAL
    curvature = (step * change).sum(1) / change.square().sum(1)
    longest = 1 / gradient.norm(dim=1).clamp(min=1.0)
    first = torch.where(curvature > 0, curvature, longest)
    inverse = first[:, None, None] * torch.eye(start.shape[1], dtype=start.dtype)
    search = _SearchState(start.clone(), loss, gradient, inverse, torch.ones_like(loss))
    everybody = torch.arange(len(start))
    for _ in range(evaluations - 2):
        search.step(problem, everybody)
    return search.unknowns


def minimise(
    problem: FitProblem,
    start: Tensor,
    evaluate: Derivatives = derivatives,
    least_step: float = CONVERGED,
) -> Tensor:
    """Return the minimum (N, W) of each person's loss from unknowns (N, W) near to it; no loss
    increases.

    Where the Hessian is not positive, the absolute values of its eigenvalues take its place
    (Dauphin et al. 2014, saddle-free Newton).

    Args:
        problem: of N people.
        start: where to begin.
        evaluate: returns loss, gradient and Hessian.
        least_step: largest step of an unknown, in standard deviations, after which a person is
            done.
    """
    count, width = start.shape
    zero = start.new_zeros(count)
    inverse = start.new_zeros(count, width, width)
    search = _SearchState(
        start.clone(), zero, torch.zeros_like(start), inverse, torch.ones_like(zero)
    )
    active = outdated = torch.arange(count)
    part = problem
    steps = torch.zeros(count, dtype=torch.int64)
    for _ in range(_MAX_EVALUATIONS):
        if len(outdated):
            loss, gradient, hessian = evaluate(problem.select(outdated), search.unknowns[outdated])
            search.loss[outdated] = loss
            search.gradient[outdated] = gradient
            search.inverse[outdated] = _positive_inverse(hessian)
        lower, length = search.step(part, active)
        steps[active] += lower
        moving = length > least_step
        outdated = active[moving & lower & (steps[active] % _STEPS_OF_HESSIAN == 0)]
        if not moving.all():
            active = active[moving]
            part = problem.select(active)
        if not len(active):
            break
    return search.unknowns


def covariance(
    problem: FitProblem, unknowns: Tensor, evaluate: Derivatives = derivatives
) -> Tensor:
    """Return the covariance (N, W, W) of the unknowns at a minimum (N, W), where the loss is -2 log
    of the probability.

    It is twice the inverse of the Hessian (Laplace's approximation), as in :func:`minimise`.
    """
    return 2 * _positive_inverse(evaluate(problem, unknowns)[2])


@dataclass(frozen=True)
class _SearchState:
    """Where N people are; changed in place.

    Attributes:
        unknowns: (N, W) unknowns.
        loss: (N,) there.
        gradient: (N, W) there.
        inverse: (N, W, W) of the Hessian, estimated.
        share: (N,) of the next step that is tried.
    """

    unknowns: Tensor
    loss: Tensor
    gradient: Tensor
    inverse: Tensor
    share: Tensor

    def step(self, problem: FitProblem, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Evaluate one step of some people, and take it where it lowers the loss; else the next is
        shorter.

        Args:
            problem: of n people.
            rows: (n,) int64, these people.

        Returns:
            Whether the step was taken (n,), and its largest change (n,) of an unknown.
        """
        newton = (self.inverse[rows] @ self.gradient[rows, :, None])[..., 0]
        step = -self.share[rows, None] * newton
        loss, gradient = loss_and_gradient(problem, self.unknowns[rows] + step)
        slope = (step * self.gradient[rows]).sum(1)
        rise = loss - self.loss[rows]
        lower = rise <= _ARMIJO * slope + _ROUNDING * self.loss[rows].abs()
        # the minimum of the parabola through both losses and the slope
        shorter = (slope / (2 * (slope - rise))).nan_to_num(0.0).clamp(0.1, 0.5)
        self.share[rows] = torch.where(lower, 1.0, self.share[rows] * shorter)
        moved_rows = rows[lower]
        change = (gradient - self.gradient[rows])[lower]
        self.inverse[moved_rows] = _bfgs_update(self.inverse[moved_rows], step[lower], change)
        self.unknowns[moved_rows] += step[lower]
        self.loss[moved_rows] = loss[lower]
        self.gradient[moved_rows] = gradient[lower]
        return lower, step.abs().amax(1)


def _bfgs_update(inverse: Tensor, step: Tensor, change: Tensor) -> Tensor:
    """Return inverse Hessians (n, W, W) after steps (n, W) that change the gradients (n, W), by the
    formula of Broyden, Fletcher, Goldfarb and Shanno; unchanged where the curvature is negative.
    """
    along = (step * change).sum(1)
    positive = along > _POSITIVE * step.norm(dim=1) * change.norm(dim=1)
    factor = torch.where(positive, 1 / along, 0.0)[:, None, None]
    turned = inverse @ change[:, :, None]
    crossed = turned * step[:, None]
    longer = 1 + factor * (change[:, None] @ turned)
    square = step[:, :, None] * step[:, None]
    return inverse + factor * (longer * square - crossed - crossed.mT)


def _positive_inverse(hessian: Tensor) -> Tensor:
    """Return the inverse (n, W, W) with the absolute values of the eigenvalues."""
    curvatures, axes = torch.linalg.eigh(hessian)
    found: Tensor = (axes / curvatures.abs().clamp(min=_LEAST_CURVATURE)[:, None]) @ axes.mT
    return found
