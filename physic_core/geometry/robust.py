"""Robust losses of squared residuals, scaled so that ``rho(x^2)`` is ``x^2`` near zero ("absolute" has no such zone).

That scaling keeps a weight's meaning when the loss changes, and makes the scale ``c`` the one number that says where a
residual begins to count as an outlier: a robust loss whose ``c`` is far above its residuals is a quadratic in disguise.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch

from physic_core.errors import PhysicError

if TYPE_CHECKING:
    from torch import Tensor

__all__ = ["absolute", "barron", "cauchy", "geman_mcclure", "pseudo_huber", "robust", "unit_robust"]


def geman_mcclure(squared: Tensor, c: float) -> Tensor:
    """Redescending: saturates at ``c^2``, so that far outliers pull no more.

    Args:
        squared: (...) squared residuals, in the unit of ``c`` squared.
        c: residual at which half of the saturation is reached.
    """
    return squared / (1.0 + squared / c**2)


def absolute(squared: Tensor) -> Tensor:
    """The residual itself, without its sign; its slope at zero is taken as zero.

    Args:
        squared: (...) squared residuals.
    """
    off = squared > 0
    return torch.where(off, torch.sqrt(torch.where(off, squared, torch.ones_like(squared))), squared)


def cauchy(squared: Tensor, c: float) -> Tensor:
    """Grows like a logarithm: outliers pull ever less, and never not at all.

    Args:
        squared: (...) squared residuals.
        c: residual at which the pull is strongest.
    """
    return c**2 * torch.log1p(squared / c**2)


def pseudo_huber(squared: Tensor, c: float) -> Tensor:
    """Quadratic below ``c``, linear above it: the pull of a large residual is bounded and constant.

    Args:
        squared: (...) squared residuals.
        c: residual at which the quadratic turns into a line.
    """
    # sqrt(1 + q) - 1 written so that it keeps its digits for small q in float32.
    q = squared / c**2
    return 2.0 * c**2 * q / (torch.sqrt(1.0 + q) + 1.0)


def barron(squared: Tensor, alpha: float, c: float) -> Tensor:
    """The general family of Barron (CVPR 2019), times ``2 c^2`` so that it is ``x^2`` near zero.

    Args:
        squared: (...) squared residuals.
        alpha: shape: 2 quadratic, 1 pseudo-Huber, 0 Cauchy, -2 Geman-McClure, ``-math.inf`` Welsch.
        c: scale.
    """
    q = squared / c**2
    if alpha == 2.0:
        return squared
    if alpha == 0.0:
        return 2.0 * c**2 * torch.log1p(q / 2.0)
    if alpha == -math.inf:
        return -2.0 * c**2 * torch.expm1(-q / 2.0)
    b = abs(alpha - 2.0)
    # expm1 and log1p keep the digits that (1 + q / b) ** (alpha / 2) - 1 would lose near zero.
    return 2.0 * c**2 * (b / alpha) * torch.expm1((alpha / 2.0) * torch.log1p(q / b))


def robust(kind: str, squared: Tensor, c: float) -> Tensor:
    """The loss that a setting names.

    Args:
        kind: "square", "absolute", "pseudo_huber", "cauchy", "geman_mcclure", or "barron": the library default of the
            paper's adaptive loss, of shape 1 and not rescaled, so half of the square near zero.
        squared: (...) squared residuals.
        c: scale; without meaning for "square" and "absolute".

    Raises:
        PhysicError: no loss has that name.
    """
    if kind == "square":
        return squared
    if kind == "absolute":
        return absolute(squared)
    if kind == "barron":
        return barron(squared, 1.0, c) / (2.0 * c**2)
    if kind not in _BY_NAME:
        raise PhysicError(
            f"no robust loss is named {kind!r}: use square, absolute, barron, {', '.join(sorted(_BY_NAME))}"
        )
    return _BY_NAME[kind](squared, c)


def unit_robust(kind: str, q: Tensor, c: float) -> tuple[Tensor, Tensor]:
    """The loss that a setting names, with its derivative, of residuals in the unit of ``c``.

    Args:
        kind: as of :func:`robust`.
        q: (...) squared residuals over ``c^2``.
        c: scale.

    Returns:
        loss: (...) ``rho(c^2 q) / c^2``.
        slope: (...) its derivative by ``q``, which is that of ``rho`` by the squared residual.

    Raises:
        PhysicError: no loss has that name.
    """
    if kind == "square":
        return q, torch.ones_like(q)
    if kind == "cauchy":
        return torch.log1p(q), 1.0 / (1.0 + q)
    if kind == "geman_mcclure":
        share = 1.0 / (1.0 + q)
        return q * share, share.square()
    if kind in ("pseudo_huber", "barron"):
        root = torch.sqrt(1.0 + q)
        loss, slope = 2.0 * q / (root + 1.0), 1.0 / root
        return (loss, slope) if kind == "pseudo_huber" else (loss / (2.0 * c**2), slope / (2.0 * c**2))
    loss = robust(kind, q * c**2, c) / c**2
    return loss, torch.where(q > 0, 0.5 / (c**2 * loss), torch.zeros_like(loss))


_BY_NAME = {"pseudo_huber": pseudo_huber, "cauchy": cauchy, "geman_mcclure": geman_mcclure}
