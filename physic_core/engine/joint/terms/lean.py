"""Term on the lean of people towards the camera."""

from __future__ import annotations

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX, joint_pair
from physic_core.engine.joint.sampling import Sampling
from physic_core.engine.joint.term import PosedBodies, Term
from physic_core.engine.state import State

_ANKLES = joint_pair("ankle")
_NECK = JOINT_INDEX["neck"]


class LeanTerm(Term):
    """Squared change of the lean towards the camera since the start, over its variance.

    The lean is the angle between the floor's normal and the line from ankles to neck, in the
    vertical plane through the camera and the ankles. The picture hardly shows it: a leg that is 1 %
    too long leans the body by several degrees.
    """

    def __init__(self, weight: float, sampling: Sampling) -> None:
        self._weight = None
        precision = lean_precision(sampling.state)
        if precision is None or not weight:
            return
        self._weight = weight * precision
        self._up = sampling.state.up
        joints = sampling.start.joints
        feet = joints[:, _ANKLES].mean(1)
        level = (feet @ self._up)[:, None] * self._up - feet
        self._towards = torch.nn.functional.normalize(level, dim=1)
        self._start = self._lean(joints)

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "lean"."""
        if self._weight is None:
            return {}
        change = self._lean(bodies.joints) - self._start
        return {"lean": self._weight * change.square()}

    def _lean(self, joints: Tensor) -> Tensor:
        """Return the lean (B,) of joints (B, 55, 3), radians; positive towards the camera."""
        column = joints[:, _NECK] - joints[:, _ANKLES].mean(1)
        return torch.atan2((column * self._towards).sum(1), column @ self._up)


def lean_precision(state: State) -> Tensor | None:
    """Return the probability that a person stands or walks, over the variance of the lean: (B,),
    1/rad^2.

    The variance is that of bodies over a known floor, and that of the floor's pitch. The result is
    0 for people whose lean is not stated; None without a stated lean or without a floor.
    """
    floor = state.scene.floor
    if state.lean_sigma is None or state.stance is None or floor is None:
        return None
    stands = 1 - (1 - torch.from_numpy(state.stance.stands).to(state.lean_sigma)).prod(1)
    return torch.nan_to_num(stands / (state.lean_sigma.square() + floor.pitch_sigma**2))
