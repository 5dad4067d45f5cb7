"""Regularisation of the paper's released code: mesh without root rotation, root rotation, and
translation.
"""

from __future__ import annotations

import torch
from torch import Tensor

from physic_core.body import LandmarkModel
from physic_core.engine.joint import PosedBodies, Sampling, Variables, parameter_energy
from physic_paper.terms.printed_regularisation import (
    PrintedRegularisationSettings,
    PrintedRegularisationTerm,
    mesh_energies,
)

_ROOT_WEIGHT = 50.0


def unrotated_vertices(
    pose: LandmarkModel, rotations: Tensor, betas: Tensor, expression: Tensor
) -> Tensor:
    """Return the subsampled vertices (B, n, 3), metres, with identity root rotation and without
    translation.

    Args:
        pose: poses the subsampled vertices.
        rotations: (B, 55, 3, 3).
        betas: (B, K).
        expression: (B, E).
    """
    root = torch.eye(3, dtype=rotations.dtype).expand(len(rotations), 1, 3, 3)
    posed = pose(
        torch.cat([root, rotations[:, 1:]], 1), betas, betas.new_zeros(len(betas), 3), expression
    )
    return posed["vertices"]


class ReleasedRegularisationTerm(PrintedRegularisationTerm):
    """Regularisation term of preset "release": ``lambda_reg (sum_v w_v |v - v0|^2 + 50 |r - r0|^2 +
    |t - t0|^2)``.

    v: vertices without root rotation. r: the first two columns of the root's rotation. t:
    translation. t0 is the translation by the body estimator.
    """

    def __init__(
        self,
        settings: PrintedRegularisationSettings,
        sampling: Sampling,
        variables: Variables,
    ) -> None:
        super().__init__(settings, sampling)
        state = sampling.state
        self._translation = (
            state.transl if state.estimated_transl is None else state.estimated_transl
        )
        others = dict.fromkeys(("pose", "hands", "betas", "translation", "offset"), 0.0)
        self._parameter_weight = variables.expand_to_parameters({"root": _ROOT_WEIGHT, **others})
        with torch.no_grad():
            start = variables.unpack()
            self._start = unrotated_vertices(
                sampling.pose, start.rotations, start.betas, state.expression
            )

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "regularisation"."""
        sampling = self._sampling
        estimate = bodies.estimate
        unrotated = unrotated_vertices(
            sampling.pose, estimate.rotations, estimate.betas, sampling.state.expression
        )
        mesh = mesh_energies(unrotated, self._start, self.weights["regularisation"])
        people = mesh + parameter_energy(bodies.deviation, self._parameter_weight)
        people = people + (estimate.transl - self._translation).square().sum(-1)
        return {"regularisation": self._settings.weight * people}
