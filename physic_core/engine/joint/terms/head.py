"""Term on the direction in which people look."""

from __future__ import annotations

import torch
from torch import Tensor

from physic_core.body.bones import head_direction
from physic_core.engine.joint.sampling import Sampling
from physic_core.engine.joint.term import PosedBodies, Term
from physic_core.geometry.robust import robust_loss

_OUTLIER_SIGMAS = 3.0  # a face may be another person's


class HeadTerm(Term):
    """Squared angle between the direction of the head and that of the observed face, over its
    variance, with a Cauchy loss.
    """

    def __init__(self, weight: float, sampling: Sampling) -> None:
        self._head = None
        state = sampling.state
        if state.head is None or state.head_sigma is None or not weight:
            return
        self._head = torch.nan_to_num(state.head)
        self.weights = {"head": torch.nan_to_num(state.head_sigma.pow(-2))}
        self._weight = weight

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "head"."""
        if self._head is None:
            return {}
        apart = (head_direction(bodies.estimate.rotations) - self._head).square().sum(1)
        square = self.weights["head"] * apart
        return {"head": self._weight * robust_loss("cauchy", square, c=_OUTLIER_SIGMAS)}
