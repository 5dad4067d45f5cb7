"""Limit term: penalty on knees and elbows beyond their range of flexion."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from physic_core.engine.distances import hinge_angles
from physic_core.engine.joint.term import PosedBodies, Term
from physic_core.types.bounds import NotNegative

_MAX_FLEXION = 2.7  # radians, of knees and elbows
_SIGMA = 1.0 / 12.0  # radians, about 5 degrees


@dataclass(frozen=True)
class LimitSettings:
    """Settings of the limit term: flexion of knees and elbows between 0 and 2.7 rad."""

    weight: NotNegative = 1.0
    """Weight of the term; 0 removes it."""


def limit_energy(rotations: Tensor) -> Tensor:
    """Return the penalty on flexion angles outside 0 to 2.7 rad: (B, 55, 3, 3) -> (B,).

    ``sum_h (max(0, -a_h)^2 + max(0, a_h - 2.7)^2) / sigma^2`` over knees and elbows.
    """
    angle = hinge_angles(rotations)
    beyond = angle - angle.clamp(0.0, _MAX_FLEXION)
    return (beyond / _SIGMA).square().sum(-1)


class LimitTerm(Term):
    """Limit term of all knees and elbows."""

    def __init__(self, settings: LimitSettings) -> None:
        self._weight = settings.weight

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "limits"."""
        return {"limits": self._weight * limit_energy(bodies.estimate.rotations)} if self._weight else {}
