"""Regularisation term L_reg: deviation of mesh and parameters from the start (paper sec. 3.3)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.state import State
from physic_core.engine.joint.term import Snapshot
from physic_core.types.bounds import NotNegative, Positive

_OCCLUDED_WEIGHT = 0.05  # of hidden vertices, and of those on invisible limbs
_PARAMETER_WEIGHTS = {"root": 0.3, "pose": 1.0, "hands": 1.0, "betas": 1.0, "offset": 1.0}
"""Weights of the deviations of each group of parameters from the start."""


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
        return mesh + self._photos * parameter_energy(deviation, self._prior_weight)
