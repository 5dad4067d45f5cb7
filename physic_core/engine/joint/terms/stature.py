"""Stature term: prior on the height of each person, which also constrains the scene's scale."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.term import PosedBodies, Term
from physic_core.engine.sizes import linearise_stature, stature_prior
from physic_core.types.bounds import NotNegative


@dataclass(frozen=True)
class StatureSettings:
    """Settings of the stature term: deviation of each person's height from the estimated height."""

    weight: NotNegative = 20.0
    """Weight; with that of the scene's scale, it splits size disagreements between people and scene; 0 removes
    the term. It is that of stated rotations: bodies whose joints hardly bend must not change their size instead."""


class StatureTerm(Term):
    """Stature term of all people: deviation of each person's height from the body estimator's result."""

    def __init__(self, settings: StatureSettings, context: JointContext) -> None:
        self._weight = settings.weight
        self._stature = linearise_stature(context.problem.model, context.problem.betas0) if settings.weight else None

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "stature"."""
        if self._stature is None:
            return {}
        prior = stature_prior(self._stature(bodies.estimate.betas), self._stature.height)
        return {"stature": self._weight * prior}
