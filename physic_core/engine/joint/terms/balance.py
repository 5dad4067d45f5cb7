"""Balance term: the centre of mass of standing people is over their feet."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from physic_core.body.joints import joint_pair
from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.term import PosedBodies, RobustLoss, Snapshot, Term
from physic_core.engine.joint.terms.contact import ContactTerm
from physic_core.geometry.robust import robust_loss
from physic_core.types.bounds import NotNegative

_STANDING_POINT = 0.35  # position of the centre of mass between ankles (0) and balls of the feet (1) in quiet standing
_FEET = [(1 - _STANDING_POINT) / 2] * 2 + [_STANDING_POINT / 2] * 2  # shares of both ankles and both toes
_FOOT_JOINTS = [*joint_pair("ankle"), *joint_pair("foot")]
_SLACK_M = 0.05  # metres around that point without a penalty
_SIGMA_M = 0.04  # expected distance beyond the slack
_LEAN_SHARE = 0.006  # of the skin, the size of a palm; a person with more contact above the knees leans on the scene


@dataclass(frozen=True)
class BalanceSettings:
    """Settings of the balance term: centre of mass over the feet, along the viewing direction."""

    weight: NotNegative = 16.0
    """Weight of the term; 0 removes it."""


def level_direction(up: Tensor) -> Tensor:
    """Return the horizontal viewing direction (3,) over a floor with the normal ``up`` (3,).

    It is 0 for a camera that points straight down.
    """
    forward = torch.stack([torch.zeros_like(up[0]), torch.zeros_like(up[0]), torch.ones_like(up[0])])
    level = forward - (forward @ up) * up
    unit: Tensor = level / level.norm().clamp(min=0.1)
    return unit


def balance_energy(mass: Tensor, joints: Tensor, level: Tensor, weight: Tensor, rho: RobustLoss) -> Tensor:
    """Return the balance energy of each person: ``w rho(max(0, |(m - f) . d| - 5 cm)^2 / sigma^2)``.

    m is the centre of mass, f a point between ankles and toes, d the horizontal viewing direction. Sideways balance is
    visible in the photo; leaning towards or away from the camera is not.

    Args:
        mass: (B, 3) centre of mass, metres.
        joints: (B, 55, 3) metres.
        level: (3,) horizontal viewing direction, from :func:`level_direction`.
        weight: (B,), 0 for people who do not stand.
    """
    at = torch.tensor(_FOOT_JOINTS, device=joints.device)
    feet = (joints.index_select(1, at) @ level) @ level.new_tensor(_FEET)
    lean = torch.relu((mass @ level - feet).abs() - _SLACK_M) / _SIGMA_M
    return weight * rho(lean.square())


class BalanceTerm(Term):
    """Balance term of people who stand without leaning on the scene.

    Args:
        contact: refreshed before this term; its vertices determine which people lean on the scene.
    """

    def __init__(self, settings: BalanceSettings, context: JointContext, contact: ContactTerm) -> None:
        self._weight, self._context, self._contact = settings.weight, context, contact
        up = context.problem.floor_normal
        self._level = None if up is None else level_direction(up)
        self._share = (context.area / context.area.sum(1, keepdim=True))[:, None]

    def refresh(self, snapshot: Snapshot) -> None:
        """Select people who stand without contact above their knees."""
        context, contact = self._context, self._contact
        rests = context.is_contact & context.above_knees & contact.touching & contact.on_scene
        leans = (context.area * rests).sum(1) > _LEAN_SHARE * context.area.sum(1)
        self.weights = {"balance": (context.standing & ~leans).to(context.area.dtype)}

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "balance"; nothing without a floor."""
        if not self._weight or self._level is None:
            return {}
        mass, rho = (self._share @ bodies.vertices)[:, 0], partial(robust_loss, "cauchy", c=1.0)
        energy = balance_energy(mass, bodies.joints, self._level, self.weights["balance"], rho)
        return {"balance": self._weight * energy}
