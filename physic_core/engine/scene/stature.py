"""Stature prior: the expected height of people constrains the scale of the scene.

A single picture shows only relative sizes, so scene scale s and stature h are two measurements of one unknown. If they
disagree by d, the energy ``(log s)^2 / sigma_s^2 + (log h)^2 / sigma_h^2`` under ``log h - log s = d`` divides d
between them. The share of the scene is ``sigma_s^2 / (sigma_s^2 + sigma_h^2)``, the posterior of two independent
measurements.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.body.model import BodyModel

__all__ = ["Stature", "stature_of", "stature_prior"]


@dataclass(frozen=True)
class Stature:
    """Standing height as a linear function of shape, valid while the top and bottom vertices do not change.

    Attributes:
        height: (B,) metres, at the start.
        slope: (B, K) metres per unit of shape.
        betas: (B, K) at the start.
    """

    height: Tensor
    slope: Tensor
    betas: Tensor

    def __call__(self, betas: Tensor) -> Tensor:
        """Height of shapes (B, K): (B,) metres."""
        return self.height + (self.slope * (betas - self.betas)).sum(-1)


def stature_of(model: BodyModel, betas: Tensor) -> Stature:
    """Linearise the standing height at a shape (B, K)."""
    with torch.enable_grad():
        start = betas.detach().clone().requires_grad_()
        height = model.stature(start)
        (slope,) = torch.autograd.grad(height.sum(), start)
    return Stature(height.detach(), slope, betas.detach())


def stature_prior(height: Tensor, expected: Tensor, sigma: float) -> Tensor:
    """``(log h - log h0)^2 / sigma^2``: (B,) metres each -> (B,)."""
    return ((height.clamp(min=0.1) / expected).log() / sigma).square()
