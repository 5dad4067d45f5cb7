"""Floor term: penalty on vertices below the floor's plane."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.robust_sum import RobustSum
from physic_core.engine.joint.term import Snapshot
from physic_core.types.bounds import NotNegative

_SIGMA_M = 0.015  # expected error of the plane, metres
_OUTLIER_SIGMAS = 2.0
_UNSEEN_SHARE = 0.3  # of the weight, for invisible limbs
_MAX_DEPTH_M = 0.2  # people with deeper vertices get no weight on invisible limbs: leg pose or floor is wrong


@dataclass(frozen=True)
class FloorSettings:
    """Settings of the floor term: penalty on vertices below the floor."""

    weight: NotNegative = 6.0
    """Weight of the term; 0 removes it."""


class FloorTerm:
    """Floor term: depth of all vertices below the floor's plane."""

    def __init__(self, settings: FloorSettings, context: JointContext) -> None:
        self.settings, self._context = settings, context
        self.weights: dict[str, Tensor] = {}

    def refresh(self, snapshot: Snapshot) -> None:
        """Update the weights: full weight on visible limbs, less on invisible ones."""
        area = self._context.area
        below = -snapshot.contacts.height.amin(1, keepdim=True).clamp(max=0.0)
        invisible = torch.where(below < _MAX_DEPTH_M, _UNSEEN_SHARE * area, torch.zeros_like(area))
        weight = torch.where(snapshot.visibility.eligible, area, invisible)
        # People far below contradict the floor or the scene's scale: they shall not draw it away from the others.
        weight = weight / (1 + (below / _MAX_DEPTH_M).square())
        self.weights = {"floor": torch.zeros_like(area) if self._context.problem.floor_normal is None else weight}

    def robust_sum(self) -> RobustSum | None:
        """Return the robust sum over depths below the floor; None if the term is off or there is no floor."""
        weight = self.settings.weight
        if not weight or self._context.problem.floor_normal is None:
            return None
        return RobustSum.of("pseudo_huber", _OUTLIER_SIGMAS, _SIGMA_M, weight * self.weights["floor"])
