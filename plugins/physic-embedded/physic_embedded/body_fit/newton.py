"""Refine body fits near a minimum with Newton's method, in about eight steps.

L-BFGS ends some centimetres short, at a place that rounding errors decide: it multiplies them by a million on the way.
At a minimum an error of the input moves the body by about as much.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

if TYPE_CHECKING:
    from torch import Tensor

    from physic_embedded.body_fit.problem import FitProblem

__all__ = ["minimize_newton"]

_STEP_SIZE = 1e-5  # of an unknown, between the two gradients whose difference is a row of the Hessian
_MIN_STEP = 1e-7  # largest step of an unknown after which a person is done
_MAX_STEPS = 50
_ROUNDING = 1e-12  # share of the loss by which rounding may seem to raise it
_DAMPING_UP, _DAMPING_DOWN, _MIN_DAMPING = (
    10.0,
    0.1,
    0.01,
)  # factors on the damping after a step that fails or holds; below the last none


def minimize_newton(problem: FitProblem, unknowns: Tensor) -> Tensor:
    """Minimise the loss of each person by Newton's method, from unknowns (N, W) near a minimum; no loss increases.

    The Hessian is the difference of gradients, those of all unknowns in one batch. Where it is not positive, the
    absolute values of its eigenvalues take its place (Dauphin et al. 2014, saddle-free Newton), damped as by Levenberg
    and Marquardt while a step does not lower the loss. People are independent and stop one by one.
    """
    found = unknowns.clone()
    active = torch.arange(len(found))
    damping = found.new_zeros(len(found))
    for _ in range(_MAX_STEPS):
        here, part = found[active], problem.select(active)
        loss, gradient, hessian = _derivatives(part, here)
        values, vectors = torch.linalg.eigh(hessian)
        along = (vectors.mT @ gradient[..., None])[..., 0] / (values.abs() + damping[:, None])
        step = -(vectors @ along[..., None])[..., 0]
        with torch.no_grad():
            lower = part.loss(here + step) <= loss + _ROUNDING * loss.abs()
        found[active] = torch.where(lower[:, None], here + step, here)
        less = torch.where(damping * _DAMPING_DOWN < _MIN_DAMPING, 0.0, damping * _DAMPING_DOWN)
        damping = torch.where(lower, less, (damping * _DAMPING_UP).clamp(min=1.0))
        moving = step.abs().amax(1) > _MIN_STEP
        active, damping = active[moving], damping[moving]
        if not len(active):
            break
    return found


def _derivatives(problem: FitProblem, unknowns: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return loss (N,), gradient (N, W) and Hessian (N, W, W)."""
    count, width = unknowns.shape
    moved = _STEP_SIZE * torch.eye(width + 1, width, dtype=unknowns.dtype).roll(1, 0)  # the first row is zero
    at = (unknowns[:, None] + moved).flatten(0, 1).requires_grad_(True)
    losses = problem.select(torch.arange(count).repeat_interleave(width + 1)).loss(at)
    (gradients,) = torch.autograd.grad(losses.sum(), at)
    gradients = gradients.view(count, width + 1, width)
    hessian = (gradients[:, 1:] - gradients[:, :1]) / _STEP_SIZE
    return losses.detach().view(count, -1)[:, 0], gradients[:, 0], (hessian + hessian.mT) / 2
