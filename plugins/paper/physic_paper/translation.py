"""Solvers of stage 2 as in the paper: Adam and L-BFGS on sums of squares.

Float64 on the CPU, metres.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor

from physic_core.engine.placement.terms import (
    TRANSLATION,
    ChamferTerm,
    PlacementReprojectionTerm,
    Residuals,
    gauss_newton,
)

_ADAM_STEPS = 30
_LEARNING_RATE = 1e-2
# Paper Sec. 4.1: "two iterations of L-BFGS" are two steps with this many inner iterations.
_LBFGS_STEPS = 2
_LBFGS_INNER = 15
_LINE_SEARCH: str | None = "strong_wolfe"  # the printed unit step diverges on the released energy
_DOUBLINGS = 40


class TranslationPrior:
    """Quadratic prior of the translation t: ``weight |t - place|^2``, with the preferred
    translation ``place``.
    """

    def __init__(self, place: Tensor, weight: float) -> None:
        self.place = place
        self.weight = weight

    def residuals(self, x: Tensor) -> list[Residuals]:
        slope = torch.eye(4, dtype=torch.float64)[:3][None]
        weight = x.new_tensor([self.weight])
        return [Residuals((x - self.place)[None, :3], slope, weight, math.inf)]


def solve_adam(loss: Callable[[Tensor], Tensor]) -> Tensor:
    """Minimise Eq. 2, a loss of the translation (3,), by Adam; return x (4,)."""
    move = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    optimizer = torch.optim.Adam([move], lr=_LEARNING_RATE)
    for _ in range(_ADAM_STEPS):
        optimizer.zero_grad()
        loss(move).backward()  # type: ignore[no-untyped-call]
        optimizer.step()
    return torch.cat((move.detach(), torch.zeros(1, dtype=torch.float64)))


def solve_lbfgs(x: Tensor, chamfer: ChamferTerm, loss: Callable[[Tensor], Tensor] | None) -> Tensor:
    """Minimise Eq. 3 from x (4,) by L-BFGS, with a line search.

    Args:
        x: (4,).
        chamfer: Eq. 4.
        loss: weighted Eq. 2 of the translation (3,); None without enough keypoints.
    """
    move = x[:3].clone().requires_grad_()
    optimizer = torch.optim.LBFGS(
        [move], lr=1.0, max_iter=_LBFGS_INNER, line_search_fn=_LINE_SEARCH
    )

    def energy() -> Tensor:
        optimizer.zero_grad()
        of_vertex, of_point = chamfer.matched(torch.cat((move.detach(), x[3:])))
        total = chamfer.weights[0] * (chamfer.vertices + move - of_vertex).square().sum()
        total = total + chamfer.weights[1] * (of_point + move - chamfer.points).square().sum()
        if loss is not None:
            total = total + loss(move)
        total.backward()  # type: ignore[no-untyped-call]
        return total

    for _ in range(_LBFGS_STEPS):
        optimizer.step(energy)  # type: ignore[no-untyped-call]
    return torch.cat((move.detach(), x[3:]))


def restore_keypoint_fit(
    reprojection: PlacementReprojectionTerm,
    x: Tensor,
    stiffness: float,
    fits: Callable[[Tensor], bool],
) -> Tensor:
    """Move x towards the minimum of the keypoint errors until ``fits(x)`` is true; return zeros if
    this fails.

    Minimises ``stiffness |t - x|^2`` plus the reprojection term with increasing weight. Up to a
    constant, the first part is Eq. 4 with fixed pairs.

    Args:
        reprojection: of a person with enough keypoints; its weight is changed.
        x: (4,) minimum of Eq. 3.
        stiffness: weight of the squared distance from ``x``.
        fits: returns whether the keypoints fit at a translation.
    """
    tied = TranslationPrior(x, stiffness)
    for _ in range(_DOUBLINGS):
        if fits(x):
            return x
        reprojection.weight = 2 * reprojection.weight
        x = gauss_newton([tied, reprojection], x, TRANSLATION)
    return torch.zeros_like(x)
