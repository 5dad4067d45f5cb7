"""Resting term: the lowest part of a foot or a knee rests on a level surface under it.

A hypothesis of :mod:`physic_core.engine.joint.resting`, not a term of a preset.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.distances import lowest_height, plane_height
from physic_core.engine.joint.term import PosedBodies, Term
from physic_core.geometry.robust import robust_loss
from physic_core.types.short_repr import ShortRepr

__all__ = ["RestingLimbs", "RestingTerm", "resting_energy"]

_WEIGHT = 4.0  # of each limb, as of the lower foot in the sole term
_SIGMA_M, _OUTLIER_SIGMAS = 0.03, 2.0


@dataclass(frozen=True)
class RestingLimbs(ShortRepr):
    """Limbs that may rest on a surface: k limbs of each of B people.

    Attributes:
        rows: per limb, rows of the subsampled vertices.
        target: (B, k) height over the floor of the surface under each limb, in the unit of the scene.
        resting: (B, k) bool, limbs that are pulled.
    """

    rows: tuple[Tensor, ...]
    target: Tensor
    resting: Tensor

    def gaps(self, height: Tensor) -> Tensor:
        """Return the distance (B, k) of each limb from its surface, for heights (B, n) over the floor."""
        return torch.stack([lowest_height(height[:, rows]) for rows in self.rows], 1) - self.target


def resting_energy(gap: Tensor, resting: Tensor) -> Tensor:
    """Return the resting energy (B,): ``w sum_k rho(g_k^2 / s^2)`` with a Cauchy loss, which pulls over any distance.

    Args:
        gap: (B, k) distance g of each limb from its surface, metres; s is 3 cm.
        resting: (B, k) bool, limbs that are pulled.
    """
    return _WEIGHT * (resting * robust_loss("cauchy", (gap / _SIGMA_M).square(), _OUTLIER_SIGMAS)).sum(1)


class RestingTerm(Term):
    """Resting term of the limbs of a hypothesis.

    Args:
        context: of an energy with a floor.
        limbs: of its people.
    """

    def __init__(self, context: JointContext, limbs: RestingLimbs) -> None:
        self._context, self._limbs = context, limbs

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "resting"; nothing without a floor."""
        context, scale = self._context, bodies.estimate.log_scale.exp()
        if context.floor_normal is None:
            return {}
        height = plane_height(bodies.vertices, context.floor_normal, context.problem.floor_offset * scale) / scale
        return {"resting": resting_energy(self._limbs.gaps(height), self._limbs.resting)}
