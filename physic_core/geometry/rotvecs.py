"""Rotation matrices from vectors in torch, with an analytic derivative.

Tests compare both with ``roma``.
"""

from __future__ import annotations

import functools
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

# Basis of the skew-symmetric matrices: row k, flattened, is the cross product with axis k.
_SKEW = ((0, 0, 0, 0, 0, -1, 0, 1, 0), (0, 0, 1, 0, 0, 0, -1, 0, 0), (0, -1, 0, 1, 0, 0, 0, 0, 0))


@functools.cache
def _skew_basis(dtype: torch.dtype) -> Tensor:
    return torch.tensor(_SKEW, dtype=dtype)


def rotvec_to_rotmat(rotvec: Tensor) -> Tensor:
    """Convert rotation vectors (..., 3), radians, to matrices (..., 3, 3); once differentiable,
    smooth everywhere.
    """
    matrix: Tensor = _RotvecToRotmat.apply(rotvec)  # type: ignore[no-untyped-call]
    return matrix


class _RotvecToRotmat(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, rotvec: Tensor) -> Tensor:
        square = rotvec.square().sum(-1, keepdim=True)
        sine, versine = _sinc_and_versine(square)
        # R = cos(t) 1 + sin(t)/t [v] + (1 - cos(t))/t^2 v v^T
        flat = sine * (rotvec @ _skew_basis(rotvec.dtype)) + versine * (
            rotvec[..., :, None] * rotvec[..., None, :]
        ).flatten(-2)
        flat[..., ::4] += 1 - versine * square
        matrix = flat.view(*rotvec.shape, 3)
        ctx.save_for_backward(rotvec, matrix, square, sine, versine)
        return matrix

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        rotvec, matrix, square, sine, versine = ctx.saved_tensors
        # dR = [J dv] R with the left Jacobian J = sin(t)/t 1 + (1 - cos(t))/t^2 [v] + (t -
        # sin(t))/t^3 v v^T
        turn = (gradients[0] @ matrix.transpose(-1, -2)).flatten(-2) @ _skew_basis(rotvec.dtype).T
        along = _jacobian_along(square, sine) * (turn * rotvec).sum(-1, keepdim=True)
        slope: Tensor = sine * turn + versine * torch.linalg.cross(turn, rotvec) + along * rotvec
        return slope


def _sinc_and_versine(square: Tensor) -> tuple[Tensor, Tensor]:
    """Return sin(t) / t and (1 - cos(t)) / t^2 of squared angles."""
    # As quotients of sines, both are accurate for small angles.
    t = square.clamp(min=1e-30).sqrt()
    half = (0.5 * t).sin() / t
    return t.sin() / t, 2 * half * half


def _jacobian_along(square: Tensor, sine: Tensor) -> Tensor:
    """Return (t - sin(t)) / t^3 of squared angles and their sin(t) / t."""
    # The series is exact to the last digit but one below the limit; the quotient divides a
    # difference of near numbers.
    limit = 1e-3 if square.dtype == torch.float64 else 0.25
    series = 1 / 6 + square * (-1 / 120 + square * (1 / 5040 - square / 362880))
    return torch.where(square < limit, series, (1 - sine) / square.clamp(min=limit))
