"""Term on the lean of people towards the camera."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX, joint_pair
from physic_core.engine.joint.sampling import Sampling
from physic_core.engine.joint.term import PosedBodies, Term
from physic_core.engine.state import State

_ANKLES = joint_pair("ankle")
_NECK = JOINT_INDEX["neck"]
_PELVIS = JOINT_INDEX["pelvis"]


class LeanTerm(Term):
    """Squared change of the lean towards the camera since the start, over its variance.

    The lean is the angle between the vertical and the line from ankles to neck, or from the pelvis
    where the photo shows no ankle, in the vertical plane through the camera and that point. The
    picture hardly shows it: a leg that is 1 % too long leans the body by several degrees.
    """

    def __init__(self, weight: float, sampling: Sampling) -> None:
        self._weight = None
        precision = lean_precision(sampling.state)
        if precision is None or not weight:
            return
        self._weight = weight * precision
        self._up = sampling.state.up
        joints = sampling.start.joints
        self._legs = ankles_observed(sampling.state)
        foot = self._foot(joints)
        level = (foot @ self._up)[:, None] * self._up - foot
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
        column = joints[:, _NECK] - self._foot(joints)
        return torch.atan2((column * self._towards).sum(1), column @ self._up)

    def _foot(self, joints: Tensor) -> Tensor:
        """Return the lower end (B, 3) of the line that leans."""
        return torch.where(self._legs[:, None], joints[:, _ANKLES].mean(1), joints[:, _PELVIS])


def ankles_observed(state: State) -> Tensor:
    """Return the people (B,) bool of whom a photo shows an ankle."""
    return state.observed_in_any_photo[:, _ANKLES].any(1)


def lean_precision(state: State) -> Tensor | None:
    """Return the probability that the lean is what the body estimator states, over its variance:
    (B,), 1/rad^2.

    For people with visible ankles, it is the probability that they stand or walk. The variance is
    that of the stated lean, and that of the vertical's pitch. The result is 0 for people whose lean
    is not stated; None without a stated lean.
    """
    if state.lean_sigma is None or state.stand_probability is None:
        return None
    floor = state.scene.floor
    pitch = math.radians(state.scene.up.sigma) if floor is None else floor.pitch_sigma
    stands = 1 - (1 - state.stand_probability).prod(1)
    stands = stands * (floor is not None)
    stated = torch.where(ankles_observed(state), stands, 1.0)
    return torch.nan_to_num(stated / (state.lean_sigma.square() + pitch**2))
