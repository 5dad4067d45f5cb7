"""Regularisation as in the released code: the mesh without root rotation, the root, and the translation."""

from __future__ import annotations

import torch
from torch import Tensor

from physic_core.body.model import LandmarkModel
from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.state import State
from physic_core.engine.joint.term import PosedBodies, View
from physic_core.engine.joint.terms.printed_regularisation import PrintedRegularisationSettings
from physic_core.engine.joint.terms.regularisation import mesh_deviation, mesh_weight, prior

__all__ = ["ReleasedRegularisationTerm", "without_root"]

_ROOT_WEIGHT = 50.0


def without_root(pose: LandmarkModel, rotations: Tensor, betas: Tensor, expression: Tensor) -> Tensor:
    """Tracked vertices (B, n, 3), metres, with the identity as root rotation and without translation.

    Args:
        pose: poses the tracked vertices.
        rotations: (B, 55, 3, 3).
        betas: (B, K).
        expression: (B, E).
    """
    root = torch.eye(3, dtype=rotations.dtype, device=rotations.device).expand(len(rotations), 1, 3, 3)
    posed = pose(torch.cat([root, rotations[:, 1:]], 1), betas, betas.new_zeros(len(betas), 3), expression)
    return posed["vertices"]


class ReleasedRegularisationTerm:
    """``lambda_reg (sum_v w_v |v - v0|^2 + 50 |r - r0|^2 + |t - t0|^2)``.

    v: vertices without root rotation. r: the first two columns of the root's rotation. t: translation. t0 is the
    translation by the body estimator.
    """

    def __init__(
        self, settings: PrintedRegularisationSettings, context: JointContext, state: State, *, occlusion_aware: bool
    ) -> None:
        self._settings, self._context, self._occlusion_aware = settings, context, occlusion_aware
        problem = context.problem
        self._translation = problem.transl0 if problem.estimated_transl is None else problem.estimated_transl
        others = dict.fromkeys(("pose", "hands", "betas", "translation", "offset", "warp"), 0.0)
        self._prior_weight = state.per_parameter({"root": _ROOT_WEIGHT, **others})
        with torch.no_grad():
            start = state.unpack()
            self._start = without_root(context.pose, start.rotations, start.betas, problem.expression0)
        self.active: dict[str, Tensor] = {}

    def refresh(self, view: View) -> None:
        """Weigh hidden vertices more."""
        s, area = self._settings, self._context.area
        weight = mesh_weight(view, s.visible_weight, s.occluded_weight, area, occlusion_aware=self._occlusion_aware)
        self.active = {"regularisation": weight}

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """ "regularisation"."""
        context, estimate = self._context, bodies.estimate
        unturned = without_root(context.pose, estimate.rotations, estimate.betas, context.problem.expression0)
        mesh = mesh_deviation(unturned, self._start, self.active["regularisation"])
        people = mesh + prior(bodies.deviation, self._prior_weight)
        people = people + (estimate.transl - self._translation).square().sum(-1)
        return {"regularisation": self._settings.weight * people}
