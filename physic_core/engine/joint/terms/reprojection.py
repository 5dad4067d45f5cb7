"""Reprojection term L_j2d: joints of the body are pulled onto the detected keypoints (paper Eq. 2)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from physic_core.engine.bounds import NotNegative, Positive, Share
from physic_core.engine.joint.context import JointContext, Keypoints
from physic_core.engine.joint.limbs import keypoints_of_observed_limbs
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.joint.term import PosedBodies, Rho, View
from physic_core.geometry.camera import project
from physic_core.geometry.robust import robust
from physic_core.geometry.visibility import inside_image

__all__ = [
    "ReprojectionSettings",
    "ReprojectionTerm",
    "confident_keypoints",
    "finite_keypoints",
    "reprojection_energy",
    "weighted_keypoints",
]

_UNSEEN_WEIGHT = 0.4  # on limbs that the photo does not show, detectors put keypoints where the rest lets expect them
_BORDER_SHARE = 0.05  # of the person: what is cut off at the border, some detectors put just inside


@dataclass(frozen=True)
class ReprojectionSettings:
    """Reprojection of the body's joints onto the keypoints.

    Attributes:
        weight: lambda_j2d of Eq. 5; 0 removes the term.
        sigma: expected error, as a share of the person's stature in px.
        outlier_sigmas: beyond this many sigmas a keypoint counts as an outlier (Cauchy).
        min_confidence: keypoints below count ``low_confidence_weight`` times as much.
        low_confidence_weight: 0 drops them.
    """

    weight: NotNegative = 1.0
    sigma: Positive = 0.01
    outlier_sigmas: Positive = 5.0
    min_confidence: Share = 0.3
    low_confidence_weight: NotNegative = 0.1

    def rho(self) -> Rho:
        """The robust loss."""
        return partial(robust, "cauchy", c=self.outlier_sigmas)


def reprojection_energy(
    projected: Tensor, observed: Tensor, weight: Tensor, unit: Tensor, rho: Rho, *, per_axis: bool = False
) -> Tensor:
    """L_j2d (Eq. 2): ``sum_j w_j rho(|(pi(J_j) - J^_j) / unit|^2)``.

    Args:
        projected: (B, J, 2) px.
        observed: (B, J, 2) px, finite.
        weight: (B, J) confidence, 0 for what was not seen.
        unit: (B, 1 or 2) px that an error of 1 stands for: a share of the person, or the image's width and height.
        rho: robust loss.
        per_axis: the robust loss takes each axis by itself.

    Returns:
        (B,).
    """
    error = (projected - observed) / unit[:, None]
    squared = error.square()
    loss = rho(squared).sum(-1) if per_axis else rho(squared.sum(-1))
    return (weight * loss).sum(-1)


class ReprojectionTerm:
    """L_j2d of all keypoints.

    Args:
        context: of the run.
        weight: lambda_j2d.
        unit: (B, 1 or 2) px that an error of 1 stands for.
        rho: robust loss.
        per_axis: the robust loss takes each axis by itself.
    """

    def __init__(self, context: JointContext, weight: float, unit: Tensor, rho: Rho, *, per_axis: bool = False) -> None:
        self._context, self._weight, self._unit, self._rho, self._per_axis = context, weight, unit, rho, per_axis
        self.active = {"reprojection": context.keypoints.weight}

    def refresh(self, view: View) -> None:
        """Keypoints do not depend on the view."""

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """ "reprojection"."""
        if not self._weight:
            return {}
        keypoints = self._context.keypoints
        projected = project(bodies.keypoints, self._context.problem.K)
        energy = reprojection_energy(
            projected, keypoints.points, keypoints.weight, self._unit, self._rho, per_axis=self._per_axis
        )
        return {"reprojection": self._weight * energy}


def finite_keypoints(problem: JointProblem) -> tuple[Tensor, Tensor]:
    """Keypoints (B, J, 2) px and confidence (B, J), both 0 where either is not finite."""
    points, confidence = problem.keypoints, problem.keypoint_confidence
    finite = torch.isfinite(points).all(-1) & torch.isfinite(confidence)
    points = torch.where(finite[..., None], points, torch.zeros_like(points))
    return points, torch.where(finite, confidence, torch.zeros_like(confidence))


def weighted_keypoints(
    problem: JointProblem, person_px: Tensor, observed: Tensor, settings: ReprojectionSettings
) -> Keypoints:
    """Keypoints with their weights: confidence, less for unsure ones and on limbs that the photo does not show.

    Args:
        problem: with finite people only.
        person_px: (B,) stature in px.
        observed: (B, 55) bool, joints that the photo shows.
        settings: of the term.
    """
    points, confidence = finite_keypoints(problem)
    height, width = problem.masks.shape[-2:]
    seen = keypoints_of_observed_limbs(problem.skeleton, observed)
    weight = torch.where(confidence < settings.min_confidence, settings.low_confidence_weight * confidence, confidence)
    # A guess is never sure.
    from_border = torch.minimum(points, points.new_tensor([width, height]) - points).amin(-1)
    off_border = from_border > _BORDER_SHARE * person_px[:, None]
    weight = torch.where(seen, weight, _UNSEEN_WEIGHT * confidence * off_border)
    weight = _inside_and_typical(problem, points, weight)
    return Keypoints(points, weight, seen & (weight >= settings.min_confidence))


def confident_keypoints(
    problem: JointProblem, person_px: Tensor, observed: Tensor, min_confidence: float = 0.0, power: float = 1.0
) -> Keypoints:
    """Keypoints weighted by a power of their confidence; those below a confidence count nothing.

    Args:
        problem: with finite people only.
        person_px: not used.
        observed: not used.
        min_confidence: keypoints below count nothing.
        power: of the confidence.
    """
    points, confidence = finite_keypoints(problem)
    weight = torch.where(confidence < min_confidence, 0.0, confidence) ** power
    weight = _inside_and_typical(problem, points, weight)
    return Keypoints(points, weight, weight >= min_confidence)


def _inside_and_typical(problem: JointProblem, points: Tensor, weight: Tensor) -> Tensor:
    """Weights without keypoints outside the picture, which a network made up, and less for loosely defined ones."""
    weight = weight * inside_image(points, *problem.masks.shape[-2:])
    skeleton = problem.skeleton
    return weight * weight.new_tensor([skeleton.weights.get(name, 1.0) for name in skeleton.names])
