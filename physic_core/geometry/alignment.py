"""Align a point map of unknown scale, or scale and shift, to another one (paper Eq. 1).

What is unknown is named by :data:`physic_core.types.AffineAmbiguity`. Each kind is solved where it is linear:

=====================  ======================  ==============================================
unknown                meaning                 residual of a pixel, as a share of its depth
=====================  ======================  ==============================================
"scale"                Q = s P                 (s Z' - Z) / Z
"scale_shift"          Q = s P + (0, 0, t)     (s P + (0, 0, t) - Q) / Z, three numbers
"inverse_scale_shift"  1 / Z = s / Z' + t      Z (s / Z' + t) - 1, each point stays on its ray
=====================  ======================  ==============================================

RANSAC scores all hypotheses with one fixed tolerance, so that they can be compared; robust least squares on the
consensus then sets the numbers. "scale_shift" uses X and Y as well, as in the paper, since only they show the scale of
a scene that is nearly at one depth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import torch
from torch import Tensor

from physic_core.types import AffineAmbiguity

__all__ = ["Alignment", "AlignmentOptions", "align", "apply_alignment", "options_as_released"]

_SEED = 0
_MAX_PIXELS = 20_000  # drawn where more are valid in both maps; more change little
_FEWEST_PIXELS = 16
_REFINEMENTS = 20
_SCORED_PIXELS = 4096
_RELATIVE_DEPTH_FLOOR = 1e-6
_SPREAD_RATIO = 5.0
_FLAT_SHARE = 0.05


@dataclass(frozen=True)
class AlignmentOptions:
    """How Eq. 1 is fitted.

    Attributes:
        tolerance: a pixel agrees when its residual is below this share of its depth. It is the same for all
            hypotheses, so that their counts can be compared.
        hypotheses: RANSAC draws; 20 in the released code.
        residual: "relative" as in the table above; "metric" multiplies it by the depth, which is Eq. 1 as printed, and
            lets what is far away decide.
    """

    tolerance: float = 0.1
    hypotheses: int = 128
    residual: Literal["relative", "metric"] = "relative"


def options_as_released(tolerance: float) -> AlignmentOptions:
    """Eq. 1 as printed, with the 20 hypotheses of the released code."""
    return AlignmentOptions(tolerance, hypotheses=20, residual="metric")


@dataclass(frozen=True)
class Alignment:
    """Scale and shift that put one point map onto another.

    Attributes:
        scale: s > 0.
        shift: t, in the target's unit ("scale_shift") or its inverse ("inverse_scale_shift").
        unknown: which formula the two numbers belong to.
        inlier_share: share of the pixels looked at whose depth agrees within the tolerance, 0-1; 0 where there was
            nothing to align, and then scale is 1 and shift 0.
        residual: median |relative depth difference| of those pixels, inf where there are none.
    """

    scale: float
    shift: float
    unknown: AffineAmbiguity
    inlier_share: float
    residual: float


class _System(NamedTuple):
    """Linear residuals A (M, R, 2) @ (s, t) - b (M, R) of M pixels; a pixel's error is the norm of its R residuals.

    The pixels' trust (M,) adds up to one.
    """

    A: Tensor
    b: Tensor
    trust: Tensor

    def errors(self, models: Tensor) -> Tensor:
        """(G, 2) models -> (G, M) squared errors."""
        total = models.new_zeros((len(models), len(self.b)))
        for r in range(self.b.shape[1]):
            total += (models @ self.A[:, r].T - self.b[:, r]).square_()
        return total


def align(
    relative_points: Tensor,
    valid: Tensor,
    target_points: Tensor,
    target_valid: Tensor,
    unknown: AffineAmbiguity,
    *,
    options: AlignmentOptions | None = None,
    axes: Literal["xyz", "z"] = "xyz",
    weight: Tensor | None = None,
) -> Alignment:
    """Find the scale and shift that put ``relative_points`` onto ``target_points`` (Eq. 1).

    Args:
        relative_points: (..., 3), any unit.
        valid: (...) bool.
        target_points: (..., 3) of the same pixels.
        target_valid: (...) bool.
        unknown: which formula to fit.
        options: of the fit; the defaults of :class:`AlignmentOptions` where None.
        axes: "z" leaves X and Y out of "scale_shift", for a target whose camera is not known.
        weight: (...) >= 0, how much each pixel counts in every step and in ``inlier_share``; equally where None.

    Returns:
        The alignment. Too few common pixels, or none that agree, give ``inlier_share`` 0 and the identity.
    """
    options = options or AlignmentOptions()
    generator = torch.Generator().manual_seed(_SEED)
    chosen = _common_pixels(relative_points, valid, target_points, target_valid, generator)
    source, target = (p.reshape(-1, 3)[chosen].double() for p in (relative_points, target_points))
    trust = torch.ones_like(source[:, 2]) if weight is None else weight.flatten()[chosen].double()
    if int((trust > 0).sum()) < _FEWEST_PIXELS:
        return _nothing(unknown)
    trust = trust / trust.sum()
    system = _relative_system(source, target, trust, unknown, axes)
    bounds = _scale_bounds(source[:, 2], target[:, 2], unknown)
    best = _ransac(system, unknown, options, bounds, generator)
    if best is None:
        return _nothing(unknown)
    model = _refine(system, best, target[:, 2], unknown, options, bounds)
    error = _relative_depth_error(source, target, model, unknown)
    inlier = error < options.tolerance
    if not bool(inlier.any()):
        return _nothing(unknown)
    return Alignment(
        scale=float(model[0]),
        shift=float(model[1]),
        unknown=unknown,
        inlier_share=min(1.0, float(trust[inlier].sum())),
        residual=float(error[inlier].median()),
    )


def apply_alignment(points: Tensor, alignment: Alignment) -> Tensor:
    """Points as the alignment puts them.

    Args:
        points: (..., 3) of the relative map.
        alignment: what :func:`align` found for that map.

    Returns:
        (..., 3) in the target's unit. Where "inverse_scale_shift" gives no positive depth (at or beyond infinity), the
        point is inf; NaN stays NaN.
    """
    if alignment.unknown == "scale":
        return points * alignment.scale
    if alignment.unknown == "scale_shift":
        return points * alignment.scale + points.new_tensor([0.0, 0.0, alignment.shift])
    z = points[..., 2]
    # Z = Z' / (s + t Z') keeps the direction: the whole point is divided.
    divisor = alignment.scale + alignment.shift * z
    factor = torch.where(divisor > 0, divisor.reciprocal(), torch.full_like(divisor, math.inf))
    return torch.where(torch.isinf(factor)[..., None], math.inf, points * factor[..., None])


def _common_pixels(
    relative: Tensor, valid: Tensor, target: Tensor, target_valid: Tensor, generator: torch.Generator
) -> Tensor:
    """(M,) flat indices of pixels that are valid in both maps, at most ``_MAX_PIXELS``, in random order."""
    chosen = (valid & target_valid).flatten().nonzero()[:, 0]
    chosen = chosen[torch.randperm(len(chosen), generator=generator)[:_MAX_PIXELS].to(chosen.device)]
    usable = torch.ones_like(chosen, dtype=torch.bool)
    for points in (relative, target):
        some = points.reshape(-1, 3)[chosen]
        usable &= torch.isfinite(some).all(-1) & (some[:, 2] > 0)
    return chosen[usable]


def _relative_system(source: Tensor, target: Tensor, trust: Tensor, unknown: AffineAmbiguity, axes: str) -> _System:
    depth = target[:, 2]
    one, zero = torch.ones_like(depth), torch.zeros_like(depth)
    if unknown == "inverse_scale_shift":
        return _System(torch.stack((depth / source[:, 2], depth), -1)[:, None], one[:, None], trust)
    along = source / depth[:, None]
    if unknown == "scale":
        return _System(torch.stack((along[:, 2], zero), -1)[:, None], one[:, None], trust)
    last = torch.stack((along[:, 2], 1 / depth), -1)
    if axes == "z":
        return _System(last[:, None], one[:, None], trust)
    side = [torch.stack((along[:, i], zero), -1) for i in (0, 1)]
    goal = target / depth[:, None]
    return _System(torch.stack((*side, last), 1), torch.stack((goal[:, 0], goal[:, 1], one), 1), trust)


def _scale_bounds(source: Tensor, target: Tensor, unknown: AffineAmbiguity) -> tuple[float, float]:
    """Scales under which the aligned map spreads about as much as the target.

    Without them a scene that is mostly one wall is best explained by a scale of zero: everything on the wall.
    """
    if unknown == "scale":
        return 0.0, math.inf
    before, after = (1 / source, 1 / target) if unknown == "inverse_scale_shift" else (source, target)
    spreads = []
    for values in (before, after):
        ordered = values.sort().values
        low, middle, high = (float(ordered[round(q * (len(ordered) - 1))]) for q in (0.05, 0.5, 0.95))
        if high - low < _FLAT_SHARE * middle:
            return 0.0, math.inf
        spreads.append(high - low)
    ratio = spreads[1] / spreads[0]
    return ratio / _SPREAD_RATIO, ratio * _SPREAD_RATIO


def _ransac(
    system: _System,
    unknown: AffineAmbiguity,
    options: AlignmentOptions,
    bounds: tuple[float, float],
    generator: torch.Generator,
) -> Tensor | None:
    """The hypothesis with the smallest truncated squared error, or None where no pixel agrees with any."""
    size = 1 if unknown == "scale" else 2
    drawn = torch.multinomial(system.trust.cpu(), options.hypotheses * size, replacement=True, generator=generator)
    picks = drawn.view(options.hypotheses, size).to(system.b.device)
    A, b = system.A[picks].flatten(1, 2), system.b[picks].flatten(1, 2)
    models = _solve(A.mT @ A, (A.mT @ b[..., None])[..., 0], unknown)
    models = models[torch.isfinite(models).all(-1) & (models[:, 0] > bounds[0]) & (models[:, 0] < bounds[1])]
    if not len(models):
        return None
    scored = _System(*(part[:_SCORED_PIXELS] for part in system))
    cost = (scored.errors(models) / options.tolerance**2).clamp_(max=1.0) @ scored.trust
    best = int(cost.argmin())
    return models[best] if float(cost[best]) < float(scored.trust.sum()) * (1 - 1e-9) else None


def _refine(
    system: _System,
    model: Tensor,
    depth: Tensor,
    unknown: AffineAmbiguity,
    options: AlignmentOptions,
    bounds: tuple[float, float],
) -> Tensor:
    """Least squares on the consensus, reweighted by a Geman-McClure kernel at the consensus' own spread."""
    scale = torch.ones_like(depth) if options.residual == "relative" else depth / depth.median()
    for _ in range(_REFINEMENTS):
        error = system.errors(model[None])[0]
        inlier = error < options.tolerance**2
        if int(inlier.sum()) < _FEWEST_PIXELS:
            return model
        # 1.4826 makes a median absolute deviation a standard deviation; the floor keeps exact data solvable.
        spread = 3 * 1.4826**2 * float(error[inlier].median()) + 1e-18
        weight = system.trust * inlier * (spread / (spread + error)).square() * scale.square()
        weighted = system.A * weight[:, None, None]
        A = torch.einsum("mri,mrj->ij", weighted, system.A)
        b = torch.einsum("mri,mr->i", weighted, system.b)
        step = _solve(A[None], b[None], unknown)[0]
        if not bool(torch.isfinite(step).all()) or not bounds[0] < float(step[0]) < bounds[1]:
            return model
        moved = float((step - model).abs().max() / model.abs().max())
        model = step
        if moved < 1e-9:
            break
    return model


def _solve(A: Tensor, b: Tensor, unknown: AffineAmbiguity) -> Tensor:
    """Solve (G, 2, 2) normal equations; NaN where one is singular; t = 0 for "scale"."""
    if unknown == "scale":
        s = b[:, 0] / A[:, 0, 0]
        return torch.stack((s, torch.zeros_like(s)), -1)
    determinant = A[:, 0, 0] * A[:, 1, 1] - A[:, 0, 1] * A[:, 1, 0]
    solvable = determinant > 1e-12 * A[:, 0, 0] * A[:, 1, 1]
    s = A[:, 1, 1] * b[:, 0] - A[:, 0, 1] * b[:, 1]
    t = A[:, 0, 0] * b[:, 1] - A[:, 1, 0] * b[:, 0]
    return torch.where(solvable[:, None], torch.stack((s, t), -1) / determinant[:, None], math.nan)


def _relative_depth_error(source: Tensor, target: Tensor, model: Tensor, unknown: AffineAmbiguity) -> Tensor:
    """(M,) |Z_aligned / Z - 1|."""
    s, t = model[0], model[1]
    if unknown == "inverse_scale_shift":
        inverse = s / source[:, 2] + t
        aligned = inverse.clamp(min=_RELATIVE_DEPTH_FLOOR).reciprocal()
    else:
        aligned = s * source[:, 2] + t
    return (aligned / target[:, 2] - 1).abs()


def _nothing(unknown: AffineAmbiguity) -> Alignment:
    return Alignment(scale=1.0, shift=0.0, unknown=unknown, inlier_share=0.0, residual=math.inf)
