"""Balance term: the centre of mass of standing people is over their feet."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from physic_core.body.joints import joint_pair
from physic_core.engine.bounds import NotNegative
from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.term import PosedBodies, RobustLoss, Snapshot, Term
from physic_core.engine.joint.terms.contact import ContactTerm
from physic_core.geometry.robust import robust_loss

__all__ = ["BalanceSettings", "BalanceTerm", "balance_energy"]

# Left and right joints are adjacent: a slice gives a view, a list of indices a copy.
_ANKLES, _TOES = (slice(left, right + 1) for left, right in (joint_pair("ankle"), joint_pair("foot")))
_STANDING_POINT = 0.35  # position of the centre of mass between ankles (0) and balls of the feet (1) in quiet standing
_SLACK_M = 0.05  # metres around that point without a penalty
_SIGMA_M = 0.04  # expected distance beyond the slack
_LEAN_SHARE = 0.006  # of the skin, the size of a palm; a person with more contact above the knees leans on the scene


@dataclass(frozen=True)
class BalanceSettings:
    """Settings of the balance term: centre of mass over the feet, along the viewing direction."""

    weight: NotNegative = 16.0
    """Weight of the term; 0 removes it."""


def balance_energy(mass: Tensor, joints: Tensor, up: Tensor, weight: Tensor, rho: RobustLoss) -> Tensor:
    """Return the balance energy of each person: ``w rho(max(0, |(m - f) . d| - 5 cm)^2 / sigma^2)``.

    m is the centre of mass, f a point between ankles and toes, d the horizontal viewing direction. Sideways balance is
    visible in the photo; leaning towards or away from the camera is not.

    Args:
        mass: (B, 3) centre of mass, metres.
        joints: (B, 55, 3) metres.
        up: (3,) unit normal of the floor.
        weight: (B,), 0 for people who do not stand.
    """
    ankles, toes = joints[:, _ANKLES].mean(1), joints[:, _TOES].mean(1)
    feet = ankles + _STANDING_POINT * (toes - ankles)
    forward = torch.stack([torch.zeros_like(up[0]), torch.zeros_like(up[0]), torch.ones_like(up[0])])
    level = forward - (forward @ up) * up
    # The viewing direction of a camera that points straight down has no horizontal part: the term is then 0.
    level = level / level.norm().clamp(min=0.1)
    lean = torch.relu(((mass - feet) @ level).abs() - _SLACK_M) / _SIGMA_M
    return weight * rho(lean.square())


class BalanceTerm(Term):
    """Balance term of people who stand without leaning on the scene.

    Args:
        contact: refreshed before this term; its vertices determine which people lean on the scene.
    """

    def __init__(self, settings: BalanceSettings, context: JointContext, contact: ContactTerm) -> None:
        self._weight, self._context, self._contact = settings.weight, context, contact

    def refresh(self, snapshot: Snapshot) -> None:
        """Select people who stand without contact above their knees."""
        context, contact = self._context, self._contact
        rests = context.is_contact & context.above_knees & contact.touching & contact.on_scene
        leans = (context.area * rests).sum(1) > _LEAN_SHARE * context.area.sum(1)
        self.weights = {"balance": (context.standing & ~leans).to(context.area.dtype)}

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "balance"; nothing without a floor."""
        up, area = self._context.problem.floor_normal, self._context.area
        if not self._weight or up is None:
            return {}
        mass = (area[:, None] @ bodies.vertices)[:, 0] / area.sum(1, keepdim=True)
        rho = partial(robust_loss, "cauchy", c=1.0)
        return {"balance": self._weight * balance_energy(mass, bodies.joints, up, self.weights["balance"], rho)}
