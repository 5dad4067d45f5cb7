"""Leg-symmetry term: a prior for similar poses of left and right leg, if both are invisible."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.bounds import NotNegative
from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.term import PosedBodies, Term

__all__ = ["LegSymmetrySettings", "LegSymmetryTerm", "leg_asymmetry"]

_LEFT_LEG, _RIGHT_LEG = (
    [JOINT_INDEX[f"{side}_{name}"] for name in ("hip", "knee", "ankle")] for side in ("left", "right")
)
_SIGMA = 0.25  # radians, spread of the difference between left and right


@dataclass(frozen=True)
class LegSymmetrySettings:
    """Settings of the leg-symmetry term, for people with invisible knees and ankles.

    Attributes:
        weight: of the term; 0 removes it.
    """

    weight: NotNegative = 2.0


def leg_asymmetry(rotations: Tensor) -> Tensor:
    """Return the asymmetry of the legs, ``sum_j 2 (1 - cos a_j) / sigma^2``: (B, 55, 3, 3) -> (B,).

    The sum is over hips, knees and ankles; a_j is the angle between the left joint and the mirrored right one.
    """
    flip = rotations.new_tensor([1.0, -1.0, -1.0])
    mirrored = rotations[:, _RIGHT_LEG] * flip[:, None] * flip
    return (rotations[:, _LEFT_LEG] - mirrored).square().sum((-1, -2, -3)) / (2 * _SIGMA**2)


class LegSymmetryTerm(Term):
    """Leg-symmetry term of people with invisible legs."""

    def __init__(self, settings: LegSymmetrySettings, context: JointContext) -> None:
        self._weight = settings.weight
        self._is_on = bool(settings.weight) and bool(context.legs_invisible.any())
        self.weights = {"symmetry": context.legs_invisible.to(context.area.dtype)}

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "symmetry"; nothing where all legs are visible."""
        if not self._is_on:
            return {}
        return {"symmetry": self._weight * (self.weights["symmetry"] * leg_asymmetry(bodies.estimate.rotations))}
