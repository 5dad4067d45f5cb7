"""Solvers of stage 2: a closed form for keypoints alone, and Gauss-Newton.

The unknown x = (t, g) is a translation and a log depth offset. Camera frame, metres; float64 on the CPU.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from physic_core.engine.placement.terms import FEWEST_KEYPOINTS, NEAREST_M, PlacementProblem, PlacementTerm, Residuals
from physic_core.geometry.robust import cauchy

TRANSLATION = (0, 1, 2)
"""Elements of x that are the translation."""

ITERATIONS = 30
"""Largest number of Gauss-Newton steps."""

_CONVERGED_M = 1e-5
_HALVINGS = 6
_MAX_OFFSET = math.log(1e3)  # largest absolute log depth offset


def closed_form_translation(person: PlacementProblem) -> Tensor:
    """Estimate the translation of Eq. 2 by linear least squares of X + t_x = u (Z + t_z); return x (4,).

    The solution is approximate: the weights of the rows approximate image errors.
    """
    ray = (person.keypoints - person.K[:2, 2]) / torch.stack((person.K[0, 0], person.K[1, 1]))
    joints = person.landmarks
    zero, one = torch.zeros(len(ray), dtype=torch.float64), torch.ones(len(ray), dtype=torch.float64)
    rows = torch.cat((torch.stack((one, zero, -ray[:, 0]), -1), torch.stack((zero, one, -ray[:, 1]), -1)))
    goal = torch.cat((ray[:, 0] * joints[:, 2] - joints[:, 0], ray[:, 1] * joints[:, 2] - joints[:, 1]))
    trust = person.confidence.repeat(2)
    move = torch.zeros_like(joints[0])
    # A weak prior of zero translation, for keypoints that do not determine depth.
    tie = torch.diag(torch.tensor([1e-9, 1e-9, 1e-6], dtype=torch.float64)) * trust.sum()
    for _ in range(3):
        depth = (joints[:, 2] + move[2]).clamp(min=NEAREST_M).repeat(2)
        weighted = rows * (trust / depth**2)[:, None]
        move = torch.linalg.solve(weighted.T @ rows + tie / depth.mean() ** 2, weighted.T @ goal)
    if float((joints[:, 2] + move[2]).min()) < NEAREST_M:
        move = torch.zeros_like(move)
    return torch.cat((move, torch.zeros(1, dtype=torch.float64)))


def gauss_newton(terms: Sequence[PlacementTerm], x: Tensor, free: Sequence[int]) -> Tensor:
    """Minimise a sum of robust terms from x (4,) by iteratively reweighted Gauss-Newton steps.

    Only the elements of x with an index in ``free`` change. A step that increases the energy is halved.
    """
    index = torch.tensor(free)
    rows = [r for term in terms for r in term.residuals(x)]
    for _ in range(ITERATIONS):
        scales = [_robust_scale(r) for r in rows]
        energy = _energy(rows, scales)
        A, b = torch.zeros(len(x), len(x), dtype=torch.float64), torch.zeros_like(x)
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
            if abs(float(x[-1] + step[-1])) <= _MAX_OFFSET:
                tried = [r for term in terms for r in term.residuals(x + step)]
                if _energy(tried, scales) <= energy:
                    x, rows = x + step, tried
                    break
            step = step / 2
        else:
            break
        if float(step.abs().max()) < _CONVERGED_M:
            break
    return x


def _robust_scale(rows: Residuals) -> float:
    """Return the scale of the settings, or twice the median error if larger."""
    if not math.isfinite(rows.scale) or len(rows.error) < FEWEST_KEYPOINTS:
        return rows.scale
    return max(rows.scale, 2 * float(torch.linalg.vector_norm(rows.error, dim=-1).median()))


def _energy(rows: Sequence[Residuals], scales: Sequence[float]) -> float:
    total = 0.0
    for r, scale in zip(rows, scales, strict=True):
        squared = r.error.square().sum(-1)
        total += float((r.weight * (cauchy(squared, scale) if math.isfinite(scale) else squared)).sum())
    return total


def term_energy(term: PlacementTerm, x: Tensor) -> float:
    """Return the energy of one term at x = (t, g), (4,)."""
    rows = term.residuals(x)
    return _energy(rows, [r.scale for r in rows])
