"""Convert rotation vectors to matrices, with an analytic derivative for fast optimisation.

Tests compare the matrices and derivatives with ``roma``.
"""

from __future__ import annotations

import functools
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

__all__ = ["rotvec_to_rotmat"]

# Basis of the skew-symmetric matrices: row k, flattened, is the cross product with axis k.
_SKEW = ((0, 0, 0, 0, 0, -1, 0, 1, 0), (0, 0, 1, 0, 0, 0, -1, 0, 0), (0, -1, 0, 1, 0, 0, 0, 0, 0))


@functools.cache
def _skew_basis(device: torch.device, dtype: torch.dtype) -> Tensor:
    return torch.tensor(_SKEW, device=device, dtype=dtype)


def rotvec_to_rotmat(rotvec: Tensor) -> Tensor:
    """Convert rotation vectors (..., 3), radians, to matrices (..., 3, 3); once differentiable, smooth everywhere."""
    matrix: Tensor = _RotvecToRotmat.apply(rotvec)  # type: ignore[no-untyped-call]
    return matrix


class _RotvecToRotmat(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, rotvec: Tensor) -> Tensor:
        skew = _skew_basis(rotvec.device, rotvec.dtype)
        square = rotvec.square().sum(-1, keepdim=True)
        sine, versine = _sinc_and_versine(square)
        # R = cos(t) 1 + sin(t)/t [v] + (1 - cos(t))/t^2 v v^T
        flat = sine * (rotvec @ skew) + versine * (rotvec[..., :, None] * rotvec[..., None, :]).flatten(-2)
        flat[..., ::4] += 1 - versine * square
        ctx.save_for_backward(rotvec, skew, square, sine, versine)
        return flat.view(*rotvec.shape, 3)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        rotvec, skew, square, sine, versine = ctx.saved_tensors
        matrix = gradients[0]
        flat = matrix.flatten(-2)
        around = flat @ skew.T
        both = ((matrix + matrix.transpose(-1, -2)) @ rotvec[..., None])[..., 0]
        sine_slope, versine_slope = _sinc_and_versine_slopes(square, sine, versine)
        along = sine_slope * (around * rotvec).sum(-1, keepdim=True)
        along = along + 0.5 * versine_slope * (both * rotvec).sum(-1, keepdim=True)
        along = along - sine * flat[..., ::4].sum(-1, keepdim=True)
        slope: Tensor = sine * around + versine * both + along * rotvec
        return slope


def _sinc_and_versine(square: Tensor) -> tuple[Tensor, Tensor]:
    """Return sin(t) / t and (1 - cos(t)) / t^2 of squared angles."""
    # As quotients of sines, both are accurate for small angles.
    t = square.clamp(min=1e-30).sqrt()
    half = (0.5 * t).sin() / t
    return t.sin() / t, 2 * half * half


def _sinc_and_versine_slopes(square: Tensor, sine: Tensor, versine: Tensor) -> tuple[Tensor, Tensor]:
    """Return the derivatives of both quotients by the angle, divided by the angle."""
    small = square < _small(square)
    t2 = torch.where(small, torch.ones_like(square), square)
    by_sine = torch.where(
        small, -1 / 3 + square * (1 / 30 + square * (-1 / 840 + square / 45360)), (1 - versine * square - sine) / t2
    )
    by_versine = torch.where(
        small, -1 / 12 + square * (1 / 180 + square * (-1 / 6720 + square / 453600)), (sine - 2 * versine) / t2
    )
    return by_sine, by_versine


def _small(square: Tensor) -> float:
    """Return the squared angle below which the series are exact to the last digit but one."""
    return 1e-3 if square.dtype == torch.float64 else 0.25
