"""Balance term: the centre of mass of people who stand on their feet alone lies over their feet."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.bounds import NotNegative
from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.term import PosedBodies, Rho, View
from physic_core.engine.joint.terms.contact import ContactTerm
from physic_core.geometry.robust import robust

__all__ = ["BalanceSettings", "BalanceTerm", "balance_energy"]

# Left and right are neighbours among the joints, and a slice is a view where a list of two is a copy.
_ANKLES, _TOES = (slice(JOINT_INDEX[f"left_{name}"], JOINT_INDEX[f"right_{name}"] + 1) for name in ("ankle", "foot"))
_STANDING_POINT = 0.35  # where, from the ankles to the balls of the feet, a quiet stander's mass is
_SLACK_M = 0.05  # round that point that are as good
_SIGMA_M = 0.04  # beyond
_LEAN_SHARE = (
    0.006  # of the skin, a palm, on the scene over the knees: this person leans and is not balanced on their feet
)


@dataclass(frozen=True)
class BalanceSettings:
    """Centre of mass over the feet, along the viewing direction.

    Attributes:
        weight: of the term; 0 removes it.
    """

    weight: NotNegative = 16.0


def balance_energy(mass: Tensor, joints: Tensor, up: Tensor, weight: Tensor, rho: Rho) -> Tensor:
    """Centre of mass over the feet along the viewing direction: ``w rho(max(0, |(m - f) . d| - 5 cm)^2 / sigma^2)``.

    A single photo shows sideways balance by itself; leaning towards or away from the camera it cannot show.

    Args:
        mass: (B, 3) centre of mass, metres.
        joints: (B, 55, 3) metres.
        up: (3,) unit normal of the floor.
        weight: (B,), 0 for people who do not stand.
        rho: robust loss.

    Returns:
        (B,).
    """
    ankles, toes = joints[:, _ANKLES].mean(1), joints[:, _TOES].mean(1)
    feet = ankles + _STANDING_POINT * (toes - ankles)
    forward = torch.stack([torch.zeros_like(up[0]), torch.zeros_like(up[0]), torch.ones_like(up[0])])
    level = forward - (forward @ up) * up
    # A camera that looks straight down has no level viewing direction: the term then vanishes with it.
    level = level / level.norm().clamp(min=0.1)
    lean = torch.relu(((mass - feet) @ level).abs() - _SLACK_M) / _SIGMA_M
    return weight * rho(lean.square())


class BalanceTerm:
    """Balance of people who stand and lean on nothing.

    Args:
        settings: of the term.
        context: of the run.
        contact: refreshed before this term; its vertices show who leans on the scene.
    """

    def __init__(self, settings: BalanceSettings, context: JointContext, contact: ContactTerm) -> None:
        self._weight, self._context, self._contact = settings.weight, context, contact
        self.active: dict[str, Tensor] = {}

    def refresh(self, view: View) -> None:
        """Choose people who stand and touch the scene nowhere over their knees."""
        context, contact = self._context, self._contact
        rests = context.is_contact & context.over_knees & contact.touching & contact.on_scene
        leans = (context.area * rests).sum(1) > _LEAN_SHARE * context.area.sum(1)
        self.active = {"balance": (context.stands & ~leans).to(context.area.dtype)}

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """ "balance"; nothing without a floor."""
        up, area = self._context.floor_normal, self._context.area
        if not self._weight or up is None:
            return {}
        mass = (area[:, None] @ bodies.vertices)[:, 0] / area.sum(1, keepdim=True)
        rho = partial(robust, "cauchy", c=1.0)
        return {"balance": self._weight * balance_energy(mass, bodies.joints, up, self.active["balance"], rho)}
