"""Rotation vectors to matrices with a hand-written derivative, for fits that turn the same joints a hundred times.

The tests hold it to ``roma``, which does everything else with rotations.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

__all__ = ["rotvec_to_rotmat"]

# Basis of the skew-symmetric matrices: row k, flattened, is the cross product with axis k.
_SKEW = ((0, 0, 0, 0, 0, -1, 0, 1, 0), (0, 0, 1, 0, 0, 0, -1, 0, 0), (0, -1, 0, 1, 0, 0, 0, 0, 0))


def rotvec_to_rotmat(rotvec: Tensor) -> Tensor:
    """Rodrigues' formula, once differentiable, everywhere smooth.

    Args:
        rotvec: (..., 3) radians.

    Returns:
        (..., 3, 3).
    """
    matrix: Tensor = _Turn.apply(rotvec)  # type: ignore[no-untyped-call]
    return matrix


class _Turn(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, rotvec: Tensor) -> Tensor:
        skew = rotvec.new_tensor(_SKEW)
        square = rotvec.square().sum(-1, keepdim=True)
        sine, versine = _shares(square)
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
        sine_slope, versine_slope = _slopes(square, sine, versine)
        along = sine_slope * (around * rotvec).sum(-1, keepdim=True)
        along = along + 0.5 * versine_slope * (both * rotvec).sum(-1, keepdim=True)
        along = along - sine * flat[..., ::4].sum(-1, keepdim=True)
        slope: Tensor = sine * around + versine * both + along * rotvec
        return slope


def _shares(square: Tensor) -> tuple[Tensor, Tensor]:
    """sin(t) / t and (1 - cos(t)) / t^2 of squared angles."""
    # As quotients of sines neither loses digits, as long as nothing is divided by zero.
    t = square.clamp(min=1e-30).sqrt()
    half = (0.5 * t).sin() / t
    return t.sin() / t, 2 * half * half


def _slopes(square: Tensor, sine: Tensor, versine: Tensor) -> tuple[Tensor, Tensor]:
    """Derivatives of the two shares by the angle, over the angle."""
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
    """Below this squared angle the series are exact to the last digit but one."""
    return 1e-3 if square.dtype == torch.float64 else 0.25
