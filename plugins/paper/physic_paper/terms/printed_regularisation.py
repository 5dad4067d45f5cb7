"""Regularisation L_reg of mesh and translation (paper Sec. 3.3), and parameter priors of PROX."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from torch import Tensor

from physic_core.engine.joint import (
    PosedBodies,
    Sampling,
    Snapshot,
    Term,
    Variables,
    parameter_energy,
    root_relative,
    vertex_weights,
)
from physic_core.types import NotNegative

_OCCLUDED_WEIGHT = 12.0  # of hidden vertices


@dataclass(frozen=True)
class PrintedRegularisationSettings:
    """Settings of the regularisation term: deviation of the root-relative mesh and of the
    translation.
    """

    weight: NotNegative = 45.0
    """Lambda_reg of Eq. 5; also of the scene's scale."""
    visible_weight: NotNegative = 1.0
    """Weight of visible vertices."""


def mesh_energies(relative: Tensor, start: Tensor, weight: Tensor) -> Tensor:
    """Return L_reg of the mesh, ``sum_v w_v |v - v0|^2``, (B,).

    Args:
        relative: (B, V, 3) vertices in the root's frame, metres.
        start: (B, V, 3) the same at the start.
        weight: (B, V).
    """
    return (weight * (relative - start).square().sum(-1)).sum(-1)


class PrintedRegularisationTerm(Term):
    """Regularisation term of the paper, root-relative vertices: ``lambda_reg (sum_v w_v |v - v0|^2
    + |t - t0|^2)``.
    """

    def __init__(self, settings: PrintedRegularisationSettings, sampling: Sampling) -> None:
        self._settings = settings
        self._sampling = sampling

    def refresh(self, snapshot: Snapshot) -> None:
        """Update the weights of visible and hidden vertices."""
        visible = self._settings.visible_weight
        weight = vertex_weights(self._sampling, snapshot, visible, _OCCLUDED_WEIGHT)
        self.weights = {"regularisation": weight}

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "regularisation"."""
        sampling = self._sampling
        relative = root_relative(
            bodies.vertices, bodies.joints[:, 0], bodies.estimate.rotations[:, 0]
        )
        mesh = mesh_energies(relative, sampling.relative, self.weights["regularisation"])
        moved = (bodies.estimate.transl - sampling.state.transl).square().sum(-1)
        return {"regularisation": self._settings.weight * (mesh + moved)}


class ParameterPriorTerm(Term):
    """Parameter prior: ``sum_i w_i x_i^2`` of the deviations from the start, with a weight per
    group.
    """

    def __init__(self, variables: Variables, weights: Mapping[str, float]) -> None:
        self._weight = variables.expand_to_parameters(weights)

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "regularisation"."""
        return {"regularisation": parameter_energy(bodies.deviation, self._weight)}
