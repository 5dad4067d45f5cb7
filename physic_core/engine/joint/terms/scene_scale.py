"""Scene-scale term: deviation of the scene's scale from the metric depth."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from physic_core.engine.joint.term import PosedBodies, Term
from physic_core.types.bounds import NotNegative


@dataclass(frozen=True)
class SceneScaleSettings:
    """Settings of the scene-scale term: change of the scene's scale."""

    weight: NotNegative = 1.5
    """Weight of the squared change, in units of its expected size."""


class SceneScaleTerm(Term):
    """Scene-scale term ``w x^2``; ``x`` is the deviation of the scale from the initial scale (``State.deviation``)."""

    def __init__(self, weight: float) -> None:
        self._weight = weight

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "scale", (1,)."""
        return {"scale": self._weight * bodies.scale_deviation.square().reshape(1)}
