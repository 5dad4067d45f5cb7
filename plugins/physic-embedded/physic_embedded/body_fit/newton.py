"""Refine body fits near a minimum with Newton's method, in about eight steps.

L-BFGS ends some centimetres short, at a place that rounding errors decide: it multiplies them by a
million on the way. At a minimum an error of the input moves the body by about as much.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import torch

from physic_embedded.body_fit.derivatives import derivatives, loss_and_gradient

if TYPE_CHECKING:
    from torch import Tensor

    from physic_embedded.body_fit.problem import FitProblem

_MIN_STEP = 1e-7  # largest step of an unknown after which a person is done
_MAX_STEPS = 100
_KEEP_HESSIAN = 0.3  # a Hessian is reused while each step is at most this share of the previous one
_ROUNDING = 1e-12  # share of the loss by which rounding may seem to raise it
_DAMPING_UP = 10.0  # factor on the damping after a failed step
_DAMPING_DOWN = 0.1  # the same after a successful one
_MIN_DAMPING = 0.01  # smaller damping is 0

Derivatives = Callable[["FitProblem", "Tensor"], tuple["Tensor", "Tensor", "Tensor"]]


def minimize_newton(
    problem: FitProblem, unknowns: Tensor, evaluate: Derivatives = derivatives
) -> Tensor:
    """Minimise the loss of each person by Newton's method, from unknowns (N, W) near a minimum; no
    loss increases.

    The Hessian costs as much as three to ten steps. It is computed again only where the steps no
    longer shrink by it (Shamanskii 1967). Where it is not positive, the absolute values of its
    eigenvalues take its place (Dauphin et al. 2014, saddle-free Newton), damped as by Levenberg and
    Marquardt while a step does not lower the loss. People are independent and stop one by one.

    Args:
        problem: of N people.
        unknowns: where to start.
        evaluate: returns loss, gradient and Hessian.
    """
    found = unknowns.clone()
    count, width = unknowns.shape
    loss = found.new_zeros(count)
    gradient = torch.zeros_like(found)
    curvatures = torch.zeros_like(found)
    axes = found.new_zeros(count, width, width)
    damping = found.new_zeros(count)
    active = outdated = torch.arange(count)
    for _ in range(_MAX_STEPS):
        if len(outdated):
            loss[outdated], gradient[outdated], hessian = evaluate(
                problem.select(outdated), found[outdated]
            )
            curvatures[outdated], axes[outdated] = torch.linalg.eigh(hessian)
        step = -_newton_step(gradient[active], curvatures[active], axes[active], damping[active])
        there = found[active] + step
        loss_there, gradient_there = loss_and_gradient(problem.select(active), there)
        lower = loss_there <= loss[active] + _ROUNDING * loss[active].abs()
        moved = active[lower]
        found[moved] = there[lower]
        loss[moved] = loss_there[lower]
        gradient[moved] = gradient_there[lower]
        less = torch.where(damping * _DAMPING_DOWN < _MIN_DAMPING, 0.0, damping * _DAMPING_DOWN)
        damping[active] = torch.where(
            lower, less[active], (damping[active] * _DAMPING_UP).clamp(min=1.0)
        )
        following = _newton_step(
            gradient[active], curvatures[active], axes[active], damping[active]
        )
        length = step.abs().amax(1)
        moving = length > _MIN_STEP
        slow = following.abs().amax(1) > _KEEP_HESSIAN * length
        active, outdated = active[moving], active[moving & lower & slow]
        if not len(active):
            break
    return found


def covariance(
    problem: FitProblem, unknowns: Tensor, evaluate: Derivatives = derivatives
) -> Tensor:
    """Return the covariance (N, W, W) of the unknowns at a minimum (N, W), where the loss is -2 log
    of the probability.

    It is twice the inverse of the Hessian (Laplace's approximation), whose eigenvalues are taken as
    in :func:`minimize_newton`.
    """
    curvatures, axes = torch.linalg.eigh(evaluate(problem, unknowns)[2])
    found: Tensor = 2 * (axes / curvatures.abs()[:, None]) @ axes.mT
    return found


def _newton_step(gradient: Tensor, curvatures: Tensor, axes: Tensor, damping: Tensor) -> Tensor:
    """Return the gradient (N, W) times the inverse of the damped Hessian, given by its eigenvalues
    and eigenvectors.
    """
    along = (axes.mT @ gradient[..., None])[..., 0] / (curvatures.abs() + damping[:, None])
    step: Tensor = (axes @ along[..., None])[..., 0]
    return step
