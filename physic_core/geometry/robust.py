"""Robust losses of squared residuals.

All but "absolute" are scaled so that ``rho(x^2)`` is ``x^2`` near zero: a weight has one meaning
for all losses. The scale ``c`` is the residual from which the loss differs from a quadratic.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from physic_core.errors import PhysicError

if TYPE_CHECKING:
    from torch import Tensor


def geman_mcclure(squared: Tensor, c: float | Tensor) -> Tensor:
    """Return the Geman-McClure loss of squared residuals (...): ``c^2 / 2`` at residual ``c``,
    always below ``c^2``.
    """
    return squared / (1.0 + squared / c**2)


def absolute(squared: Tensor) -> Tensor:
    """Return the absolute residuals of squared residuals (...), with derivative zero at zero."""
    off = squared > 0
    return torch.where(off, torch.sqrt(torch.where(off, squared, 1.0)), squared)


def cauchy(squared: Tensor, c: float | Tensor) -> Tensor:
    """Return the Cauchy loss of squared residuals (...), with the largest derivative at residual
    ``c``.
    """
    return c**2 * torch.log1p(squared / c**2)


def pseudo_huber(squared: Tensor, c: float | Tensor) -> Tensor:
    """Return the pseudo-Huber loss of squared residuals (...): quadratic below ``c``, linear
    above.
    """
    # Equal to sqrt(1 + q) - 1, but accurate for small q in float32.
    q = squared / c**2
    return 2.0 * c**2 * q / (torch.sqrt(1.0 + q) + 1.0)


_BY_NAME = {"pseudo_huber": pseudo_huber, "cauchy": cauchy, "geman_mcclure": geman_mcclure}


def robust_loss(kind: str, squared: Tensor, c: float | Tensor) -> Tensor:
    """Return the loss ``kind`` of squared residuals.

    Args:
        kind: "square", "absolute", "pseudo_huber", "cauchy", "geman_mcclure", or "barron": the
            default of the library that the paper uses, of shape 1 and half of the square near zero.
        squared: (...) squared residuals.
        c: scale, one for all or (...); not used by "square" and "absolute".

    Raises:
        PhysicError: ``kind`` is unknown.
    """
    if kind == "square":
        return squared
    if kind == "absolute":
        return absolute(squared)
    if kind == "barron":
        return 2.0 * c**2 * torch.expm1(0.5 * torch.log1p(squared / c**2)) / (2.0 * c**2)
    if kind not in _BY_NAME:
        raise PhysicError(
            f"unknown robust loss {kind!r}: use square, absolute, barron, "
            f"{', '.join(sorted(_BY_NAME))}"
        )
    return _BY_NAME[kind](squared, c)


def loss_with_slope(kind: str, q: Tensor, c: float | Tensor) -> tuple[Tensor, Tensor]:
    """Return the robust loss ``kind`` and the derivative, for squared residuals divided by ``c^2``.

    Args:
        kind: as in :func:`robust_loss`.
        q: (...) squared residuals over ``c^2``.
        c: scale.

    Returns:
        loss: (...) ``rho(c^2 q) / c^2``.
        slope: (...) its derivative by ``q``, equal to that of ``rho`` by the squared residual.

    Raises:
        PhysicError: ``kind`` is unknown.
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
        loss = 2.0 * q / (root + 1.0)
        slope = 1.0 / root
        return (
            (loss, slope) if kind == "pseudo_huber" else (loss / (2.0 * c**2), slope / (2.0 * c**2))
        )
    loss = robust_loss(kind, q * c**2, c) / c**2
    return loss, torch.where(q > 0, 0.5 / (c**2 * loss), 0.0)
