"""Regularisation term L_reg: deviation of mesh and parameters from the start (paper sec. 3.3)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.body.joints import PARENTS
from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.joint.state import State
from physic_core.engine.joint.term import Snapshot
from physic_core.types.bounds import NotNegative, Positive

_OCCLUDED_WEIGHT = 0.05  # of hidden vertices, and of those on invisible limbs
_PARAMETER_WEIGHTS = {"root": 0.3, "pose": 1.0, "hands": 1.0, "betas": 1.0, "offset": 1.0}
"""Weights of the deviations of each group of parameters from the start."""

_STATED_WEIGHT = 20.0
"""Weight of a deviation as large as the error that the body estimator states. It is more than the 1 of independent
errors: those of a photo's depth, floor and keypoints are common to all vertices and keypoints, which the other terms
count one by one."""
_LEAST_ROTATION_SIGMA = 0.01  # radians


@dataclass(frozen=True)
class RegularisationSettings:
    """Settings of the regularisation term: deviation of root-relative mesh and parameters from the start."""

    sigma_m: Positive = 0.06
    """Expected change of a vertex of weight 1, root-relative, metres."""
    visible_weight: NotNegative = 0.01
    """Weight of visible vertices."""
    translation_weight: NotNegative = 0.05
    """Weight of the translation."""


def parameter_energy(deviation: Tensor, weight: Tensor) -> Tensor:
    """Return the L_reg of parameter deviations (B, P), whitened or raw: ``sum_i w_i x_i^2`` (B,), weights (P,)."""
    return deviation.square() @ weight


def vertex_weights(
    snapshot: Snapshot, visible: float, occluded: float, area: Tensor, *, occlusion_aware: bool = True
) -> Tensor:
    """Return the L_reg weight of each vertex (B, n): vertex area times ``visible``, or ``occluded`` if not visible."""
    strong = ~snapshot.visibility.eligible
    if occlusion_aware:
        strong = strong | snapshot.visibility.hidden
    return torch.where(strong, occluded, visible).to(area.dtype) * area


def stated_weights(problem: JointProblem, expected: Tensor) -> Tensor:
    """Return the weights (B, 22) of the rotations of pelvis and body joints, by the errors that the estimator states.

    NaN where it states none, and where the photo shows no joint that the rotation moves.

    Args:
        problem: of B people.
        expected: (22,) radians, expected angles of correction, in which deviations are measured.
    """
    if problem.rotation_sigma is None:
        return expected.new_full((len(problem), len(expected)), torch.nan)
    children = [[j for j, parent in enumerate(PARENTS) if parent == i] or [i] for i in range(len(expected))]
    shown = torch.stack([problem.observed[:, moved].any(1) for moved in children], 1)
    sigma = problem.rotation_sigma.to(expected).clamp(min=_LEAST_ROTATION_SIGMA)
    return torch.where(shown, _STATED_WEIGHT * (expected / sigma).square(), torch.nan)


class RegularisationTerm:
    """Regularisation term, evaluated by :class:`physic_core.engine.joint.terms.surface.SurfaceTerms`.

    The squared error of a start decreases with its number n of photos: all weights are n times those for one
    photo.
    """

    def __init__(
        self, settings: RegularisationSettings, context: JointContext, state: State, *, occlusion_aware: bool
    ) -> None:
        self._settings, self._context, self._occlusion_aware = settings, context, occlusion_aware
        self._photos = context.problem.photos
        self._prior_weight = state.expand_to_parameters(
            _PARAMETER_WEIGHTS | {"translation": settings.translation_weight}
        )
        stated = stated_weights(context.problem, state.expected_turns).repeat_interleave(3, 1)
        added = stated - self._prior_weight[: stated.shape[1]]
        self._stated_beyond_prior = torch.where(added.isfinite(), added, 0.0)
        self.weights: dict[str, Tensor] = {}

    def refresh(self, snapshot: Snapshot) -> None:
        """Update the weights of visible and hidden vertices."""
        s = self._settings
        weight = vertex_weights(
            snapshot, s.visible_weight, _OCCLUDED_WEIGHT, self._context.area, occlusion_aware=self._occlusion_aware
        )
        self.weights = {"regularisation": self._photos[:, None] * weight / s.sigma_m**2}

    def energy(self, mesh: Tensor, deviation: Tensor) -> Tensor:
        """Return the energy (B,): the mesh energy ``mesh`` (B,) plus the energy of parameter deviations (B, P)."""
        turns = deviation[:, : self._stated_beyond_prior.shape[1]]
        stated = (self._stated_beyond_prior * turns.square()).sum(1)
        return mesh + self._photos * (parameter_energy(deviation, self._prior_weight) + stated)
