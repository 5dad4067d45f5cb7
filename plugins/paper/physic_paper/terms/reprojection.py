"""Keypoints weighted by confidence, and the reprojection term of PROX."""

from __future__ import annotations

import torch
from torch import Tensor

from physic_core.engine.joint import (
    PosedBodies,
    RobustLoss,
    Sampling,
    Term,
    finite_keypoints,
    weights_inside_image,
)
from physic_core.engine.state import State
from physic_core.geometry import project


def confidence_weights(state: State, min_confidence: float = 0.0, power: float = 1.0) -> Tensor:
    """Return the weights (B, J) of the keypoints: a power of their confidence, 0 below
    ``min_confidence``.
    """
    points, confidence = finite_keypoints(state)
    weight = torch.where(confidence < min_confidence, 0.0, confidence) ** power
    return weights_inside_image(state, points, weight)


def offset_loss(squared: Tensor, rho: RobustLoss, *, per_axis: bool) -> Tensor:
    """Return the robust loss of offsets from squared components (..., D): of the length, or summed
    over the axes.
    """
    return rho(squared).sum(-1) if per_axis else rho(squared.sum(-1))


class ReprojectionByAxisTerm(Term):
    """Reprojection term with a robust loss of each axis: ``sum_j w_j sum_a rho(((pi(J_j) - J^_j)_a
    / unit)^2)``.

    Args:
        weight: of the term; 0 removes it.
        unit: px, the error of size 1.
        rho: robust loss.
    """

    def __init__(self, sampling: Sampling, weight: float, unit: float, rho: RobustLoss) -> None:
        self._sampling = sampling
        self._weight = weight
        self._unit = unit
        self._rho = rho
        self._observed, _ = finite_keypoints(sampling.state)
        self.weights = {"reprojection": sampling.keypoint_weights}

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "reprojection"."""
        if not self._weight:
            return {}
        error = (project(bodies.keypoints, self._sampling.state.K) - self._observed) / self._unit
        loss = offset_loss(error.square(), self._rho, per_axis=True)
        return {"reprojection": self._weight * (self._sampling.keypoint_weights * loss).sum(-1)}
