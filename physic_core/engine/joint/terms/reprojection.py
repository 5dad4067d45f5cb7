"""Reprojection term L_j2d: projected joints of the body against detected keypoints (paper Eq. 2)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from physic_core.engine.joint.context import JointContext, WeightedKeypoints
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.joint.term import PosedBodies, RobustLoss, Term
from physic_core.engine.limbs import keypoints_of_observed_limbs
from physic_core.geometry.camera import project
from physic_core.geometry.robust import robust_loss
from physic_core.geometry.visibility import inside_image
from physic_core.types.bounds import NotNegative, Positive

_INVISIBLE_WEIGHT = 0.4  # of keypoints on invisible limbs, which detectors extrapolate from the visible ones

_MIN_CONFIDENCE = 0.3  # keypoints of lower confidence are skipped


@dataclass(frozen=True)
class ReprojectionSettings:
    """Settings of the reprojection term: projected joints of the body against keypoints."""

    weight: NotNegative = 1.0
    """Lambda_j2d of Eq. 5; 0 removes the term."""
    sigma: Positive = 0.01
    """Expected error, as a share of the person's stature in px."""
    outlier_sigmas: Positive = 5.0
    """Beyond this many sigmas a keypoint counts as an outlier (Cauchy)."""

    def rho(self) -> RobustLoss:
        """Return the robust loss of reprojection errors: Cauchy with scale ``outlier_sigmas``."""
        return partial(robust_loss, "cauchy", c=self.outlier_sigmas)


def reprojection_energy(projected: Tensor, observed: Tensor, weight: Tensor, unit: Tensor, rho: RobustLoss) -> Tensor:
    """Return the energy L_j2d (Eq. 2) of each person (B,): ``sum_j w_j rho(|(pi(J_j) - J^_j) / unit|^2)``, unit in px.

    Args:
        projected: (B, J, 2) px.
        observed: (B, J, 2) px, finite.
        weight: (B, J), 0 for keypoints that are skipped.
        unit: (B, 1 or 2) px, the error of size 1: a share of the person, or the image's width and height.
    """
    error = (projected - observed) / unit[:, None]
    return (weight * rho(error.square().sum(-1))).sum(-1)


class ReprojectionTerm(Term):
    """Reprojection term L_j2d of all keypoints, with the arguments of :func:`reprojection_energy`."""

    def __init__(self, context: JointContext, weight: float, unit: Tensor, rho: RobustLoss) -> None:
        self._context, self._unit, self._rho = context, unit, rho
        self.weights = {"reprojection": context.keypoints.weight}
        self._weight = weight * context.keypoints.weight if weight else None

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "reprojection"."""
        if self._weight is None:
            return {}
        projected = project(bodies.keypoints, self._context.problem.K)
        observed = self._context.keypoints.points
        return {"reprojection": reprojection_energy(projected, observed, self._weight, self._unit, self._rho)}


def finite_keypoints(problem: JointProblem) -> tuple[Tensor, Tensor]:
    """Return keypoints (B, J, 2) px and confidence (B, J); both are set to 0 if either is not finite."""
    points, confidence = problem.keypoints, problem.keypoint_confidence
    finite = torch.isfinite(points).all(-1) & torch.isfinite(confidence)
    points = torch.where(finite[..., None], points, torch.zeros_like(points))
    return points, torch.where(finite, confidence, torch.zeros_like(confidence))


def weighted_keypoints(problem: JointProblem) -> WeightedKeypoints:
    """Return the keypoints of finite people, with less weight on limbs that are not visible in any photo."""
    points, confidence = finite_keypoints(problem)
    seen = keypoints_of_observed_limbs(problem.skeleton, problem.observed_anywhere)
    weight = torch.where(confidence < _MIN_CONFIDENCE, 0.0, confidence)
    weight = torch.where(seen, weight, _INVISIBLE_WEIGHT * confidence)
    weight = weights_inside_image(problem, points, weight)
    return WeightedKeypoints(points, weight)


def weights_inside_image(problem: JointProblem, points: Tensor, weight: Tensor) -> Tensor:
    """Return the weights (B, J), multiplied by those of the skeleton, and 0 for keypoints outside the image."""
    weight = weight * inside_image(points, *problem.masks.shape[-2:])
    skeleton = problem.skeleton
    return weight * weight.new_tensor([skeleton.weights.get(name, 1.0) for name in skeleton.names])
