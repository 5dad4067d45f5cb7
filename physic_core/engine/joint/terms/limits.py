"""Limit term: bounds on the flexion of knees and elbows."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.bounds import NotNegative
from physic_core.engine.joint.distances import hinge_angles
from physic_core.engine.joint.term import PosedBodies, View

__all__ = ["LimitSettings", "LimitTerm", "limit_energy"]

_MAX_FLEXION = 2.7  # radians; a knee or an elbow bends no further
_SIGMA = 1.0 / 12.0  # radians, about 5 degrees


@dataclass(frozen=True)
class LimitSettings:
    """Bounds on the flexion of knees and elbows, 0 to 2.7 rad.

    Attributes:
        weight: of the term; 0 removes it.
    """

    weight: NotNegative = 1.0


def limit_energy(rotations: Tensor) -> Tensor:
    """One-sided limits: ``sum_h (max(0, -a_h)^2 + max(0, a_h - 2.7)^2) / sigma^2`` over knees and elbows.

    Args:
        rotations: (B, 55, 3, 3).

    Returns:
        (B,).
    """
    angle = hinge_angles(rotations)
    beyond = torch.relu(-angle) + torch.relu(angle - _MAX_FLEXION)
    return (beyond / _SIGMA).square().sum(-1)


class LimitTerm:
    """Limits of all people's knees and elbows."""

    def __init__(self, settings: LimitSettings) -> None:
        self._weight = settings.weight
        self.active: dict[str, Tensor] = {}

    def refresh(self, view: View) -> None:
        """Limits do not depend on the view."""

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """ "limits"."""
        return {"limits": self._weight * limit_energy(bodies.estimate.rotations)} if self._weight else {}
