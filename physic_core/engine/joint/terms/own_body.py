"""Own body term: a visible hand at the own body touches it, without being inside it.

Keypoints hold a hand across the rays, and little holds it along them.
"""

from __future__ import annotations

import torch
from torch import Tensor

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.own_hands import find_own_pairs, hands_of
from physic_core.engine.joint.people_pairs import PeoplePairs, select_probes
from physic_core.engine.joint.robust_sum import RobustSum
from physic_core.engine.joint.term import PosedBodies, Snapshot, Term
from physic_core.engine.joint.terms.contact import ContactSettings
from physic_core.engine.joint.terms.penetration import PenetrationSettings
from physic_core.engine.joint.terms.people import GAP_SIGMAS, INSIDE_SIGMAS, SIGMA_M, PairEnergies

__all__ = ["OwnBodyTerm"]


class OwnBodyTerm(Term):
    """Own body term, with the equation of the people term. Pairs are kept from one refresh to the next.

    Args:
        contact: settings, of which the weights are used.
        penetration: the same.
        context: constants of the optimisation.
        joints: (B, 55, 3) metres, which decide whose hands may be pulled.
    """

    def __init__(
        self, contact: ContactSettings, penetration: PenetrationSettings, context: JointContext, joints: Tensor
    ) -> None:
        self._touch_weight = contact.weight * contact.people_weight
        self._apart_weight = penetration.weight * penetration.people_weight
        self.pairs: PeoplePairs | None = None
        model, ids = context.problem.model, context.ids
        self._probes = select_probes(model, ids, context.area)
        self._hands = hands_of(model, ids, self._probes.rows, context.on_visible_part, joints)

    def refresh(self, snapshot: Snapshot) -> None:
        """Find the pairs of vertices near each other, and those that touch."""
        found = find_own_pairs(self._hands, snapshot.vertices, snapshot.visibility.normals)
        self.pairs = None
        if found is not None:
            self.pairs, touches = found
            area = self._probes.area[self.pairs.person, self.pairs.probe]
            self._apart = RobustSum.of("pseudo_huber", INSIDE_SIGMAS, SIGMA_M, self._apart_weight * area)
            self._touch = RobustSum.of("geman_mcclure", GAP_SIGMAS, SIGMA_M, self._touch_weight * area * touches)

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy of the pairs; zero if no hand is near the own body."""
        energy = torch.zeros_like(bodies.vertices[:, 0, 0])
        if self.pairs is not None:
            energy = PairEnergies.apply(  # type: ignore[no-untyped-call]
                bodies.vertices, self.pairs, self._apart, self._touch
            )
        return {"own_body": energy}
