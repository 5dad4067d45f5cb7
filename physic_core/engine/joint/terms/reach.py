"""Reach term: a visible hand in front of another person touches that person, although their depths differ.

The people term moves surfaces that are near each other. This one acts along the rays, over a larger distance, and
corrects the relative depth of two people.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from physic_core.body.joints import SIDES
from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.reaching_hands import Hand, Reach, ReachingPairs, find_reaches, meeting_pairs
from physic_core.engine.joint.term import PosedBodies, Snapshot, Term
from physic_core.engine.joint.terms.contact import ContactSettings
from physic_core.geometry.robust import geman_mcclure

__all__ = ["ReachTerm", "reach_energy"]

_NEAR_M = 0.02  # surfaces that are nearer touch each other
_REACH_M = 0.25  # the error of the relative depth of two people is 7 cm (rms), and rarely larger than this
_SIGMA_M = 0.05  # expected error of the relative depth of two people
_OUTLIER_SIGMAS = 3.0  # beyond this many sigmas the hand may be in front of the person without contact
_SHOWN = 0.5  # of a hand's vertices, inside the person's mask
_WEIGHT = 4.0  # of one hand, relative to a square decimetre in contact; 10 gives the same contacts


def reach_energy(apart: Tensor, share: Tensor) -> Tensor:
    """Return the energy of pairs (p,): ``w rho(a^2 / s^2)``, with a Geman-McClure loss.

    Args:
        apart: (p,) a, difference of the depths of a pair, metres; s is 5 cm.
        share: (p,) weight w.
    """
    return share * geman_mcclure((apart / _SIGMA_M).square(), _OUTLIER_SIGMAS)


class ReachTerm(Term):
    """Reach term: pairs are found at each refresh, and kept until the next one.

    Args:
        settings: of contact, of which the weights are used.
        context: constants of the optimisation.
    """

    def __init__(self, settings: ContactSettings, context: JointContext) -> None:
        self._weight = _WEIGHT * settings.weight * settings.people_weight
        self._hands: list[Hand] = []
        self._reaches: list[Reach] | None = None
        self.pairs: ReachingPairs
        if not self._weight or len(context.area) < 2:
            return
        model = context.problem.model
        part, names = model.part_of_vertex[context.ids], model.part_names
        hands = _rows(part, [names.index(f"{side}_hand") for side in SIDES])
        for side in SIDES:
            rows = _rows(part, [names.index(f"{side}_hand")])
            rest = _rows(part, [k for k, name in enumerate(names) if name not in (f"{side}_hand", f"{side}_lower_arm")])
            for person in context.on_visible_part[:, rows].any(1).nonzero(as_tuple=True)[0].tolist():
                self._hands.append(Hand(person, rows, rest, hands))

    @property
    def links(self) -> Tensor:
        """Pairs (p, 2) int64 of the owners of hands and the people whom they reach."""
        return torch.stack([self.pairs.person, self.pairs.other], 1)

    def refresh(self, snapshot: Snapshot) -> None:
        """Find the vertices where hands meet people; who meets whom is decided at the first refresh."""
        if not self._hands:
            return
        vertices = snapshot.vertices
        if self._reaches is None:
            shown = snapshot.visibility.in_mask
            hands = [hand for hand in self._hands if shown[hand.person, hand.rows].double().mean() >= _SHOWN]
            self._reaches = find_reaches(hands, vertices, _NEAR_M, _REACH_M)
        self.pairs = meeting_pairs(self._reaches, vertices)

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy of the pairs; zero if no hand is apart from a person behind it."""
        if not self._hands:
            return {}
        depth, pairs = bodies.vertices[..., 2], self.pairs
        energy = torch.zeros_like(depth[:, 0])
        if len(pairs):
            apart = depth[pairs.person, pairs.row] - depth[pairs.other, pairs.other_row]
            energy = energy.index_add(0, pairs.person, reach_energy(apart, self._weight * pairs.share))
        return {"reach": energy}


def _rows(part: Tensor, parts: Sequence[int]) -> Tensor:
    """Return the rows of the vertices (n,) on some parts."""
    return torch.isin(part, part.new_tensor(parts)).nonzero(as_tuple=True)[0]
