"""Regularisation as printed: L_reg of mesh and translation (paper sec. 3.3). Also PROX's priors of the parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from torch import Tensor

from physic_core.engine.bounds import NotNegative
from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.distances import root_relative
from physic_core.engine.joint.state import State
from physic_core.engine.joint.term import PosedBodies, View
from physic_core.engine.joint.terms.regularisation import mesh_deviation, mesh_weight, prior

__all__ = ["ParameterPriorTerm", "PrintedRegularisationSettings", "PrintedRegularisationTerm"]


@dataclass(frozen=True)
class PrintedRegularisationSettings:
    """Deviation of the root-relative mesh and of the translation.

    Attributes:
        weight: lambda_reg of Eq. 5; also of the scene's scale.
        visible_weight: of visible vertices.
        occluded_weight: of hidden vertices.
    """

    weight: NotNegative = 45.0
    visible_weight: NotNegative = 1.0
    occluded_weight: NotNegative = 12.0


class PrintedRegularisationTerm:
    """``lambda_reg (sum_v w_v |v - v0|^2 + |t - t0|^2)``, vertices in the root's frame."""

    def __init__(
        self, settings: PrintedRegularisationSettings, context: JointContext, *, occlusion_aware: bool
    ) -> None:
        self._settings, self._context, self._occlusion_aware = settings, context, occlusion_aware
        self.active: dict[str, Tensor] = {}

    def refresh(self, view: View) -> None:
        """Weigh hidden vertices more."""
        s, area = self._settings, self._context.area
        weight = mesh_weight(view, s.visible_weight, s.occluded_weight, area, occlusion_aware=self._occlusion_aware)
        self.active = {"regularisation": weight}

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """ "regularisation"."""
        context = self._context
        relative = root_relative(bodies.vertices, bodies.joints[:, 0], bodies.estimate.rotations[:, 0])
        mesh = mesh_deviation(relative, context.relative, self.active["regularisation"])
        moved = (bodies.estimate.transl - context.problem.transl0).square().sum(-1)
        return {"regularisation": self._settings.weight * (mesh + moved)}


class ParameterPriorTerm:
    """``sum_i w_i x_i^2`` of the parameters' deviations, by group."""

    def __init__(self, state: State, weights: Mapping[str, float]) -> None:
        self._weight = state.per_parameter(weights)
        self.active: dict[str, Tensor] = {}

    def refresh(self, view: View) -> None:
        """Parameters do not depend on the view."""

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """ "regularisation"."""
        return {"regularisation": prior(bodies.deviation, self._weight)}
