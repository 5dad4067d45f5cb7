"""Newton's method for the body fit: from near a minimum into it, in about eight steps.

L-BFGS ends some centimetres short, at a place that rounding errors decide: it multiplies them by a million on the way.
At a minimum an error of the input moves the body by about as much.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

if TYPE_CHECKING:
    from torch import Tensor

    from physic_embedded.body_fit.problem import FitProblem

__all__ = ["converge"]

_DIFFERENCE = 1e-5  # of an unknown, between the two gradients whose difference is a row of the Hessian
_CONVERGED = 1e-7  # largest step of an unknown after which a person is done
_MAX_STEPS = 50
_ROUNDING = 1e-12  # share of the loss by which rounding may seem to raise it
_MORE, _LESS, _LEAST = 10.0, 0.1, 0.01  # factors on the damping after a step that fails or holds; below the last none


def converge(problem: FitProblem, unknowns: Tensor) -> Tensor:
    """Unknowns (N, W) near minima of the loss of each person -> (N, W) at them; no person's loss rises.

    The Hessian is the difference of gradients, those of all unknowns in one batch. Where it is not positive, the
    absolute values of its eigenvalues take its place (Dauphin et al. 2014, saddle-free Newton), damped as by Levenberg
    and Marquardt while a step does not lower the loss. People are independent and stop one by one.
    """
    found = unknowns.clone()
    active = torch.arange(len(found))
    damping = found.new_zeros(len(found))
    for _ in range(_MAX_STEPS):
        here, part = found[active], problem.pick(active)
        loss, gradient, hessian = _derivatives(part, here)
        values, vectors = torch.linalg.eigh(hessian)
        along = (vectors.mT @ gradient[..., None])[..., 0] / (values.abs() + damping[:, None])
        step = -(vectors @ along[..., None])[..., 0]
        with torch.no_grad():
            lower = part.loss(here + step) <= loss + _ROUNDING * loss.abs()
        found[active] = torch.where(lower[:, None], here + step, here)
        less = torch.where(damping * _LESS < _LEAST, 0.0, damping * _LESS)
        damping = torch.where(lower, less, (damping * _MORE).clamp(min=1.0))
        moving = step.abs().amax(1) > _CONVERGED
        active, damping = active[moving], damping[moving]
        if not len(active):
            break
    return found


def _derivatives(problem: FitProblem, unknowns: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Loss (N,), gradient (N, W) and Hessian (N, W, W)."""
    count, width = unknowns.shape
    moved = _DIFFERENCE * torch.eye(width + 1, width, dtype=unknowns.dtype).roll(1, 0)  # the first row is zero
    at = (unknowns[:, None] + moved).flatten(0, 1).requires_grad_(True)
    losses = problem.pick(torch.arange(count).repeat_interleave(width + 1)).loss(at)
    (gradients,) = torch.autograd.grad(losses.sum(), at)
    gradients = gradients.view(count, width + 1, width)
    hessian = (gradients[:, 1:] - gradients[:, :1]) / _DIFFERENCE
    return losses.detach().view(count, -1)[:, 0], gradients[:, 0], (hessian + hessian.mT) / 2
