"""Floor term: penalises vertices under the floor's plane."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.bounds import NotNegative
from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.robust_sum import RobustSum
from physic_core.engine.joint.term import View

__all__ = ["FloorSettings", "FloorTerm"]

_SIGMA_M = 0.015  # expected error of the plane, metres
_OUTLIER_SIGMAS = 2.0
_UNSEEN_SHARE = 0.3  # of the weight, for invisible limbs
_SUNK_M = 0.2  # deeper invisible limbs are left out: leg pose or floor is wrong


@dataclass(frozen=True)
class FloorSettings:
    """Vertices under the floor, by :func:`physic_core.engine.joint.terms.penetration.penetration_energy`.

    Attributes:
        weight: of the term; 0 removes it.
    """

    weight: NotNegative = 6.0


class FloorTerm:
    """Depth under the floor's plane, of all vertices."""

    def __init__(self, settings: FloorSettings, context: JointContext) -> None:
        self.settings, self._context = settings, context
        self.active: dict[str, Tensor] = {}

    def refresh(self, view: View) -> None:
        """Set the weights: visible limbs count in full, the others less."""
        area = self._context.area
        shallow = view.contacts.height.amin(1, keepdim=True) > -_SUNK_M
        guessed = torch.where(shallow, _UNSEEN_SHARE * area, torch.zeros_like(area))
        weight = torch.where(view.visibility.in_play, area, guessed)
        self.active = {"floor": torch.zeros_like(area) if self._context.floor_normal is None else weight}

    def robust_sum(self) -> RobustSum | None:
        """Weights of the depth under the floor; None where the term is off or there is no floor."""
        weight = self.settings.weight
        if not weight or self._context.floor_normal is None:
            return None
        return RobustSum.of("pseudo_huber", _OUTLIER_SIGMAS, _SIGMA_M, weight * self.active["floor"])
