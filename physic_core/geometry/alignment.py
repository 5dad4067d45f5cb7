"""Align a relative point map to another point map by scale, or by scale and shift (paper Eq. 1).

:data:`physic_core.types.AffineAmbiguity` names the unknowns. Each residual is linear in them:

=====================  ======================  ==============================================
unknown                meaning                 residual of a pixel, as a share of its depth
=====================  ======================  ==============================================
"scale"                Q = s P                 (s Z' - Z) / Z
"scale_shift"          Q = s P + (0, 0, t)     (s P + (0, 0, t) - Q) / Z, three numbers
"inverse_scale_shift"  1 / Z = s / Z' + t      Z (s / Z' + t) - 1, each point stays on its ray
=====================  ======================  ==============================================

RANSAC scores all hypotheses with one tolerance. Robust least squares on the inliers refines the
best. "scale_shift" uses X and Y too, as in the paper: they determine the scale of a scene at nearly
one depth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import torch
from torch import Tensor

from physic_core.geometry.pixels import quantiles
from physic_core.types import AffineAmbiguity

_SEED = 0
_MAX_PIXELS = 20_000  # random sample of the common pixels
_FEWEST_PIXELS = 16
_REFINEMENTS = 20
_SCORED_PIXELS = 4096
_RELATIVE_DEPTH_FLOOR = 1e-6
_SPREAD_RATIO = 5.0
_FLAT_SHARE = 0.05


@dataclass(frozen=True)
class AlignmentOptions:
    """Options of the fit of Eq. 1.

    Attributes:
        tolerance: largest relative depth error of an inlier; the same for all hypotheses.
        hypotheses: number of RANSAC hypotheses; 20 in the released code.
        residual: "relative" as in the table above. "metric" multiplies it by the depth, as Eq. 1 is
            printed; far pixels then dominate.
        axes: "z" ignores X and Y in "scale_shift", for a target without a known camera.
    """

    tolerance: float = 0.1
    hypotheses: int = 128
    residual: Literal["relative", "metric"] = "relative"
    axes: Literal["xyz", "z"] = "xyz"


@dataclass(frozen=True)
class Alignment:
    """Scale and shift from one point map to another.

    Attributes:
        scale: s > 0.
        shift: t, in the target's unit ("scale_shift") or its inverse ("inverse_scale_shift").
        unknown: formula that scale and shift belong to.
        inlier_share: weighted share of the used pixels with a depth error within the tolerance,
            0-1. If it is 0, the scale is 1 and the shift 0.
        residual: median absolute relative depth difference of the inliers; inf if there are none.
    """

    scale: float
    shift: float
    unknown: AffineAmbiguity
    inlier_share: float
    residual: float


class _LinearSystem(NamedTuple):
    """Linear residuals ``A @ (s, t) - b`` of M pixels, R residuals each."""

    A: Tensor  # (M, R, 2)
    b: Tensor  # (M, R)
    weight: Tensor  # (M,), of sum 1

    def errors(self, models: Tensor) -> Tensor:
        """Return the squared errors (G, M) of models (G, 2)."""
        total = models.new_zeros((len(models), len(self.b)))
        for r in range(self.b.shape[1]):
            total += (models @ self.A[:, r].T - self.b[:, r]).square_()
        return total


def fit_alignment(
    relative_points: Tensor,
    target_points: Tensor,
    valid: Tensor,
    unknown: AffineAmbiguity,
    *,
    options: AlignmentOptions | None = None,
    weight: Tensor | None = None,
) -> Alignment:
    """Estimate the scale and shift from ``relative_points`` to ``target_points`` (Eq. 1).

    Args:
        relative_points: (..., 3), any unit.
        target_points: (..., 3) of the same pixels.
        valid: (...) bool, pixels that are valid in both.
        unknown: formula to fit.
        options: of the fit; default :class:`AlignmentOptions`.
        weight: (...) >= 0, weight of each pixel in the fit and in ``inlier_share``; uniform if
            None.

    Returns:
        The alignment; the identity with ``inlier_share`` 0 if there are too few common pixels or no
        inliers.
    """
    options = options or AlignmentOptions()
    generator = torch.Generator().manual_seed(_SEED)
    chosen = _sample_pixels(relative_points, target_points, valid, generator)
    source, target = (p.reshape(-1, 3)[chosen].double() for p in (relative_points, target_points))
    weights = torch.ones_like(source[:, 2]) if weight is None else weight.flatten()[chosen].double()
    if int((weights > 0).sum()) < _FEWEST_PIXELS:
        return _no_alignment(unknown)
    weights = weights / weights.sum()
    system = _linear_system(source, target, weights, unknown, options.axes)
    bounds = _scale_bounds(source[:, 2], target[:, 2], unknown)
    best = _ransac_alignment(system, unknown, options, bounds, generator)
    if best is None:
        return _no_alignment(unknown)
    model = _refine_alignment(system, best, target[:, 2], unknown, options, bounds)
    error = _relative_depth_error(source, target, model, unknown)
    inlier = error < options.tolerance
    if not inlier.any():
        return _no_alignment(unknown)
    return Alignment(
        scale=float(model[0]),
        shift=float(model[1]),
        unknown=unknown,
        inlier_share=min(1.0, float(weights[inlier].sum())),
        residual=float(error[inlier].median()),
    )


def apply_alignment(points: Tensor, alignment: Alignment) -> Tensor:
    """Apply an alignment to points (..., 3).

    A point with no positive depth under "inverse_scale_shift" becomes inf. NaN stays NaN.
    """
    if alignment.unknown == "scale":
        return points * alignment.scale
    if alignment.unknown == "scale_shift":
        return points * alignment.scale + points.new_tensor([0.0, 0.0, alignment.shift])
    z = points[..., 2]
    # Z = Z' / (s + t Z') keeps the direction: the whole point is divided.
    divisor = alignment.scale + alignment.shift * z
    factor = torch.where(divisor > 0, divisor.reciprocal(), math.inf)
    return torch.where(torch.isinf(factor)[..., None], math.inf, points * factor[..., None])


def _sample_pixels(
    relative: Tensor, target: Tensor, valid: Tensor, generator: torch.Generator
) -> Tensor:
    """Return flat indices (M,) of valid pixels, at most ``_MAX_PIXELS``, in random order."""
    chosen = valid.flatten().nonzero()[:, 0]
    chosen = chosen[torch.randperm(len(chosen), generator=generator)[:_MAX_PIXELS]]
    usable = torch.ones_like(chosen, dtype=torch.bool)
    for points in (relative, target):
        some = points.reshape(-1, 3)[chosen]
        usable &= torch.isfinite(some).all(-1) & (some[:, 2] > 0)
    return chosen[usable]


def _linear_system(
    source: Tensor, target: Tensor, weights: Tensor, unknown: AffineAmbiguity, axes: str
) -> _LinearSystem:
    depth = target[:, 2]
    ones = torch.ones_like(depth)
    zeros = torch.zeros_like(depth)
    if unknown == "inverse_scale_shift":
        return _LinearSystem(
            torch.stack((depth / source[:, 2], depth), -1)[:, None], ones[:, None], weights
        )
    along = source / depth[:, None]
    if unknown == "scale":
        return _LinearSystem(torch.stack((along[:, 2], zeros), -1)[:, None], ones[:, None], weights)
    last = torch.stack((along[:, 2], 1 / depth), -1)
    if axes == "z":
        return _LinearSystem(last[:, None], ones[:, None], weights)
    side = [torch.stack((along[:, i], zeros), -1) for i in (0, 1)]
    goal = target / depth[:, None]
    return _LinearSystem(
        torch.stack((*side, last), 1), torch.stack((goal[:, 0], goal[:, 1], ones), 1), weights
    )


def _scale_bounds(source: Tensor, target: Tensor, unknown: AffineAmbiguity) -> tuple[float, float]:
    """Return the least and greatest scale at which the aligned depths spread about as widely as the
    target's.

    Without bounds, a scale of zero fits a scene that is mostly one wall.
    """
    if unknown == "scale":
        return 0.0, math.inf
    before, after = (
        (1 / source, 1 / target) if unknown == "inverse_scale_shift" else (source, target)
    )
    spreads = []
    for values in (before, after):
        low, median_value, high = quantiles(values, (0.05, 0.5, 0.95))
        if high - low < _FLAT_SHARE * median_value:
            return 0.0, math.inf
        spreads.append(high - low)
    ratio = spreads[1] / spreads[0]
    return ratio / _SPREAD_RATIO, ratio * _SPREAD_RATIO


def _ransac_alignment(
    system: _LinearSystem,
    unknown: AffineAmbiguity,
    options: AlignmentOptions,
    bounds: tuple[float, float],
    generator: torch.Generator,
) -> Tensor | None:
    """Return the hypothesis (2,) with the least truncated squared error, or None if it has no
    inlier.
    """
    size = 1 if unknown == "scale" else 2
    drawn = torch.multinomial(
        system.weight, options.hypotheses * size, replacement=True, generator=generator
    )
    picks = drawn.view(options.hypotheses, size)
    A = system.A[picks].flatten(1, 2)
    b = system.b[picks].flatten(1, 2)
    models = _solve_least_squares(A.mT @ A, (A.mT @ b[..., None])[..., 0], unknown)
    models = models[
        torch.isfinite(models).all(-1) & (models[:, 0] > bounds[0]) & (models[:, 0] < bounds[1])
    ]
    if not len(models):
        return None
    scored = _LinearSystem(*(part[:_SCORED_PIXELS] for part in system))
    cost = (scored.errors(models) / options.tolerance**2).clamp_(max=1.0) @ scored.weight
    best = int(cost.argmin())
    return models[best] if float(cost[best]) < float(scored.weight.sum()) * (1 - 1e-9) else None


def _refine_alignment(
    system: _LinearSystem,
    model: Tensor,
    depth: Tensor,
    unknown: AffineAmbiguity,
    options: AlignmentOptions,
    bounds: tuple[float, float],
) -> Tensor:
    """Refine a model by least squares on its inliers, reweighted by a Geman-McClure kernel."""
    scale = torch.ones_like(depth) if options.residual == "relative" else depth / depth.median()
    for _ in range(_REFINEMENTS):
        error = system.errors(model[None])[0]
        inlier = error < options.tolerance**2
        if int(inlier.sum()) < _FEWEST_PIXELS:
            return model
        # 1.4826 makes a median absolute deviation a standard deviation; the floor keeps exact data
        # solvable.
        spread = 3 * 1.4826**2 * float(error[inlier].median()) + 1e-18
        weight = system.weight * inlier * (spread / (spread + error)).square() * scale.square()
        weighted = system.A * weight[:, None, None]
        A = torch.einsum("mri,mrj->ij", weighted, system.A)
        b = torch.einsum("mri,mr->i", weighted, system.b)
        step = _solve_least_squares(A[None], b[None], unknown)[0]
        if not torch.isfinite(step).all() or not bounds[0] < float(step[0]) < bounds[1]:
            return model
        relative_change = float((step - model).abs().max() / model.abs().max())
        model = step
        if relative_change < 1e-9:
            break
    return model


def _solve_least_squares(A: Tensor, b: Tensor, unknown: AffineAmbiguity) -> Tensor:
    """Solve normal equations (G, 2, 2); NaN for a singular one, and t = 0 for "scale"."""
    if unknown == "scale":
        s = b[:, 0] / A[:, 0, 0]
        return torch.stack((s, torch.zeros_like(s)), -1)
    determinant = A[:, 0, 0] * A[:, 1, 1] - A[:, 0, 1] * A[:, 1, 0]
    solvable = determinant > 1e-12 * A[:, 0, 0] * A[:, 1, 1]
    s = A[:, 1, 1] * b[:, 0] - A[:, 0, 1] * b[:, 1]
    t = A[:, 0, 0] * b[:, 1] - A[:, 1, 0] * b[:, 0]
    return torch.where(solvable[:, None], torch.stack((s, t), -1) / determinant[:, None], math.nan)


def _relative_depth_error(
    source: Tensor, target: Tensor, model: Tensor, unknown: AffineAmbiguity
) -> Tensor:
    """Return ``|Z_aligned / Z - 1|`` (M,) of a model."""
    s = model[0]
    t = model[1]
    if unknown == "inverse_scale_shift":
        inverse = s / source[:, 2] + t
        aligned = inverse.clamp(min=_RELATIVE_DEPTH_FLOOR).reciprocal()
    else:
        aligned = s * source[:, 2] + t
    return (aligned / target[:, 2] - 1).abs()


def _no_alignment(unknown: AffineAmbiguity) -> Alignment:
    return Alignment(scale=1.0, shift=0.0, unknown=unknown, inlier_share=0.0, residual=math.inf)
