"""Solvers of stage 2 over translation and log depth offset x = (t, g): Gauss-Newton, and the paper's Adam and L-BFGS.

Preset "default" uses Gauss-Newton. Camera frame, metres; float64 on the CPU.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from physic_core.engine.joint.released.reprojection import released_reprojection
from physic_core.engine.placement.settings import PlacementSettings
from physic_core.engine.placement.terms import (
    FEWEST_KEYPOINTS,
    NEAREST_M,
    Chamfer,
    Reprojection,
    Rows,
    Subject,
    Term,
    Tied,
)
from physic_core.geometry.camera import project
from physic_core.geometry.robust import cauchy

__all__ = ["adam", "closed_form", "gauss_newton", "lbfgs", "loss", "reprojection_loss", "within_keypoints"]

ITERATIONS = 30
"""Gauss-Newton steps at most, and Adam's steps on Eq. 2 (paper Sec. 4.1)."""

# Paper Sec. 4.1: "two iterations of L-BFGS" are two steps with this many inner iterations.
_LEARNING_RATE = 1e-2
_LBFGS_STEPS, _LBFGS_INNER = 2, 15
_LINE_SEARCH: str | None = "strong_wolfe"  # the printed unit step diverges on the released energy

_CONVERGED_M = 1e-5
_HALVINGS = 6
_MAX_OFFSET = math.log(1e3)  # of depth, absolute value
_DOUBLINGS = 40


def closed_form(person: Subject) -> Tensor:
    """Initial translation (3,) for Eq. 2: X + t_x = x (Z + t_z) is linear in t; rows are weighted to image errors."""
    ray = (person.keypoints - person.K[:2, 2]) / torch.stack((person.K[0, 0], person.K[1, 1]))
    joints = person.landmarks
    zero, one = torch.zeros(len(ray), dtype=torch.float64), torch.ones(len(ray), dtype=torch.float64)
    rows = torch.cat((torch.stack((one, zero, -ray[:, 0]), -1), torch.stack((zero, one, -ray[:, 1]), -1)))
    goal = torch.cat((ray[:, 0] * joints[:, 2] - joints[:, 0], ray[:, 1] * joints[:, 2] - joints[:, 1]))
    trust = person.confidence.repeat(2)
    move = torch.zeros(3, dtype=torch.float64)
    # A weak prior on the estimated position, for keypoints that do not determine depth.
    tie = torch.diag(torch.tensor([1e-9, 1e-9, 1e-6], dtype=torch.float64)) * trust.sum()
    for _ in range(3):
        depth = (joints[:, 2] + move[2]).clamp(min=NEAREST_M).repeat(2)
        weighted = rows * (trust / depth**2)[:, None]
        move = torch.linalg.solve(weighted.T @ rows + tie / depth.mean() ** 2, weighted.T @ goal)
    if float((joints[:, 2] + move[2]).min()) < NEAREST_M:
        move = torch.zeros_like(move)
    return torch.cat((move, torch.zeros(1, dtype=torch.float64)))


def gauss_newton(terms: Sequence[Term], x: Tensor, free: Sequence[int]) -> Tensor:
    """Minimise the sum of robust terms from x (4,) by iteratively reweighted Gauss-Newton steps.

    Only the numbers of x with an index in ``free`` change. A step that does not lower the energy is halved.
    """
    index = torch.tensor(free)
    rows = [r for term in terms for r in term.rows(x)]
    for _ in range(ITERATIONS):
        scales = [_robust_scale(r) for r in rows]
        energy = _energy(rows, scales)
        A = torch.zeros((4, 4), dtype=torch.float64)
        b = torch.zeros(4, dtype=torch.float64)
        for r, scale in zip(rows, scales, strict=True):
            # Derivative of the Cauchy loss by the squared error: 1 / (1 + e^2 / c^2).
            weight = r.weight / (1 + r.error.square().sum(-1) / scale**2)
            A += torch.einsum("n,ndi,ndj->ij", weight, r.slope, r.slope)
            b += torch.einsum("n,ndi,nd->i", weight, r.slope, r.error)
        A, b = A[index][:, index], b[index]
        A = A + 1e-9 * torch.diag(A.diagonal().clamp(min=1e-12))
        step = torch.zeros_like(x)
        step[index] = torch.linalg.solve(A, -b)
        for _ in range(_HALVINGS):
            # The exponential of a larger offset may overflow.
            if abs(float(x[3] + step[3])) <= _MAX_OFFSET:
                tried = [r for term in terms for r in term.rows(x + step)]
                if _energy(tried, scales) <= energy:
                    x, rows = x + step, tried
                    break
            step = step / 2
        else:
            break
        if float(step.abs().max()) < _CONVERGED_M:
            break
    return x


def _robust_scale(rows: Rows) -> float:
    """The settings' scale, or the median error if larger, so that a common error is no outlier."""
    if not math.isfinite(rows.scale) or len(rows.error) < FEWEST_KEYPOINTS:
        return rows.scale
    return max(rows.scale, 2 * float(torch.linalg.vector_norm(rows.error, dim=-1).median()))


def _energy(rows: Sequence[Rows], scales: Sequence[float]) -> float:
    total = 0.0
    for r, scale in zip(rows, scales, strict=True):
        squared = r.error.square().sum(-1)
        total += float((r.weight * (cauchy(squared, scale) if math.isfinite(scale) else squared)).sum())
    return total


def loss(term: Term, x: Tensor) -> float:
    """Value of one term at x (4,)."""
    rows = term.rows(x)
    return _energy(rows, [r.scale for r in rows])


def adam(person: Subject, settings: PlacementSettings) -> Tensor:
    """Eq. 2 as the paper minimises it: gradient descent with Adam."""
    move = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    optimizer = torch.optim.Adam([move], lr=_LEARNING_RATE)
    for _ in range(ITERATIONS):
        optimizer.zero_grad()
        reprojection_loss(person, move, settings).backward()  # type: ignore[no-untyped-call]
        optimizer.step()
    return torch.cat((move.detach(), torch.zeros(1, dtype=torch.float64)))


def lbfgs(person: Subject, x: Tensor, chamfer: Chamfer, settings: PlacementSettings) -> Tensor:
    """Eq. 3 as the paper minimises it: L-BFGS of unit rate, here with a line search."""
    move = x[:3].clone().requires_grad_()
    optimizer = torch.optim.LBFGS([move], lr=1.0, max_iter=_LBFGS_INNER, line_search_fn=_LINE_SEARCH)

    def energy() -> Tensor:
        optimizer.zero_grad()
        of_vertex, of_point = chamfer.matched(torch.cat((move.detach(), x[3:])))
        total = chamfer.weights[0] * (chamfer.vertices + move - of_vertex).square().sum()
        total = total + chamfer.weights[1] * (of_point + move - chamfer.points).square().sum()
        if len(person.keypoints) >= FEWEST_KEYPOINTS:
            total = total + settings.reprojection_weight * reprojection_loss(person, move, settings)
        total.backward()  # type: ignore[no-untyped-call]
        return total

    for _ in range(_LBFGS_STEPS):
        optimizer.step(energy)  # type: ignore[no-untyped-call]
    return torch.cat((move.detach(), x[3:]))


def within_keypoints(
    person: Subject, x: Tensor, stiffness: float, settings: PlacementSettings, fits: Callable[[Tensor], bool]
) -> Tensor:
    """The translation nearest to x whose keypoints fit, by Eq. 3 with fixed pairs; zero if none does.

    Up to a constant, squared distances of fixed pairs are ``stiffness |t - x|^2``.

    Args:
        person: with enough keypoints.
        x: the minimum of Eq. 3.
        stiffness: weight of the squared distance from there.
        settings: of stage 2.
        fits: whether the keypoints fit at a translation.
    """
    tied, reprojection = Tied(x, stiffness), Reprojection(person, settings)
    for _ in range(_DOUBLINGS):
        if fits(x):
            return x
        reprojection.weight = 2 * reprojection.weight
        x = gauss_newton([tied, reprojection], x, (0, 1, 2))
    return torch.zeros_like(x)


def reprojection_loss(person: Subject, move: Tensor, settings: PlacementSettings) -> Tensor:
    """L_j2d after a translation (3,) metres, unweighted: ()."""
    seen = project(person.landmarks + move, person.K)
    if settings.method == "released":
        one = (seen[None], person.keypoints[None], person.confidence[None])
        return released_reprojection(*one, person.size, person.people).sum()
    error = (seen - person.keypoints) / person.size
    total = (person.confidence * error.square().sum(-1)).sum()
    return total / person.confidence.sum() if settings.robust else total
