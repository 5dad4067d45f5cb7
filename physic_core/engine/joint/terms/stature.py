"""Stature term: a prior on each person's height, which also constrains the scene's scale."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from physic_core.engine.bounds import NotNegative
from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.term import PosedBodies, View
from physic_core.engine.scene.stature import stature_of, stature_prior

__all__ = ["STATURE_SIGMA", "StatureSettings", "StatureTerm"]

STATURE_SIGMA = 0.06
"""Expected error of log(stature), beside the 0.054 of the embedded body's shape prior of weight 1: 0.04 of both."""


@dataclass(frozen=True)
class StatureSettings:
    """Change of the stature, by :func:`physic_core.engine.scene.stature.stature_prior`.

    Attributes:
        weight: with the weight of the scene's scale it divides a disagreement of sizes between people and
            scene; 0 removes the term.
    """

    weight: NotNegative = 1.0


class StatureTerm:
    """Stature of all people against the body estimator's."""

    def __init__(self, settings: StatureSettings, context: JointContext) -> None:
        self._weight = settings.weight
        self._stature = stature_of(context.problem.model, context.problem.betas0) if settings.weight else None
        self.active: dict[str, Tensor] = {}

    def refresh(self, view: View) -> None:
        """Stature does not depend on the view."""

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """ "stature"."""
        if self._stature is None:
            return {}
        prior = stature_prior(self._stature(bodies.estimate.betas), self._stature.height, STATURE_SIGMA)
        return {"stature": self._weight * prior}
