"""People term: people touch each other without being inside each other.

The scene of the paper has no people, so that nothing there keeps two bodies apart.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.people_pairs import PeoplePairs, find_people_pairs, select_probes
from physic_core.engine.joint.robust_sum import RobustSum
from physic_core.engine.joint.term import PosedBodies, Snapshot, Term
from physic_core.engine.joint.terms.contact import ContactSettings
from physic_core.engine.joint.terms.penetration import PenetrationSettings
from physic_core.geometry.robust import geman_mcclure, pseudo_huber

__all__ = ["GAP_SIGMAS", "INSIDE_SIGMAS", "SIGMA_M", "PairEnergies", "PeopleTerm", "pair_energy"]

_TOUCHING_PARTS = ("left_hand", "right_hand")
_REACH_M = 0.06  # of the search, for vertices that are deep inside
_MAX_GAP_M = 0.04  # of hands that may touch
_NEARLY_INSIDE_M = 0.02  # other vertices are not expected to come inside before the next refresh
_SLACK_M = 0.005  # depth without a penalty: soft tissue gives way
SIGMA_M = 0.02  # expected error of the distance between two surfaces
INSIDE_SIGMAS = 2.0  # beyond this many sigmas the gradient of penetration is constant
GAP_SIGMAS = 1.5  # beyond this many sigmas a gap counts as an outlier


def pair_energy(distance: Tensor, apart: Tensor, touch: Tensor) -> Tensor:
    """Return the energy of pairs of vertices (p,): ``a rho(max(0, -d - 5 mm)^2 / s^2) + t rho'(max(0, d)^2 / s^2)``.

    rho is a pseudo-Huber loss, and rho' a Geman-McClure loss, which ignores far contacts.

    Args:
        distance: (p,) d along the normal of the other body, metres, negative inside it; s is 2 cm.
        apart: (p,) weight a of penetration.
        touch: (p,) weight t of contact.
    """
    inside, gap = torch.relu(-distance - _SLACK_M) / SIGMA_M, torch.relu(distance) / SIGMA_M
    return apart * pseudo_huber(inside.square(), INSIDE_SIGMAS) + touch * geman_mcclure(gap.square(), GAP_SIGMAS)


class PairEnergies(torch.autograd.Function):
    """Energy of each person (B,) by :func:`pair_energy`, with analytic derivatives by the vertices (B, n, 3).

    The overhead of autograd for these small arrays exceeds their cost.
    """

    @staticmethod
    def forward(ctx: Any, vertices: Tensor, pairs: PeoplePairs, apart: RobustSum, touch: RobustSum) -> Tensor:
        count = vertices.shape[1]
        flat, rows = vertices.reshape(-1, 3), pairs.person * count + pairs.row
        other_rows = pairs.other * count + pairs.other_row
        distance = ((flat[rows] - flat[other_rows]) * pairs.normal).sum(-1)
        inside, by_inside = apart.values_and_slopes(torch.relu(-distance - _SLACK_M))
        gap, by_gap = touch.values_and_slopes(torch.relu(distance))
        ctx.vertices, ctx.rows, ctx.other_rows, ctx.pairs = vertices.shape, rows, other_rows, pairs
        ctx.slope = by_gap - by_inside
        return vertices.new_zeros(len(vertices)).index_add(0, pairs.person, inside + gap)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        force = (gradients[0][ctx.pairs.person] * ctx.slope)[:, None] * ctx.pairs.normal
        by_vertex = force.new_zeros(ctx.vertices).reshape(-1, 3)
        by_vertex.index_add_(0, ctx.rows, force).index_add_(0, ctx.other_rows, -force)
        return by_vertex.reshape(ctx.vertices), None, None, None


class PeopleTerm(Term):
    """People term: pairs are found at each refresh, and kept until the next one.

    Args:
        contact: settings, of which the weights are used.
        penetration: the same.
        context: constants of the optimisation.
    """

    def __init__(self, contact: ContactSettings, penetration: PenetrationSettings, context: JointContext) -> None:
        self._touch_weight = contact.weight * contact.people_weight
        self._apart_weight = penetration.weight * penetration.people_weight
        self._is_on = bool(self._touch_weight or self._apart_weight) and len(context.area) > 1
        self.pairs: PeoplePairs
        if self._is_on:
            model = context.problem.model
            self._probes = select_probes(model, context.ids, context.area)
            touching = torch.tensor([name in _TOUCHING_PARTS for name in model.part_names], device=context.ids.device)
            self._may_touch = context.on_visible_part & touching[model.part_of_vertex[context.ids]]

    @property
    def links(self) -> Tensor:
        """Pairs (p, 2) int64 of people with vertices near each other."""
        return torch.stack([self.pairs.person, self.pairs.other], 1)

    def refresh(self, snapshot: Snapshot) -> None:
        """Find the pairs of vertices near each other, and those that touch."""
        if not self._is_on:
            return
        found = find_people_pairs(self._probes, snapshot.vertices, snapshot.visibility.normals, _REACH_M)
        touches = self._may_touch[found.person, found.row] & (found.distance < _MAX_GAP_M)
        kept = touches | (found.distance < _NEARLY_INSIDE_M)
        self.pairs, touches = found.select(kept), touches[kept]
        area = self._probes.area[self.pairs.person, self.pairs.probe]
        self._apart = RobustSum.of("pseudo_huber", INSIDE_SIGMAS, SIGMA_M, self._apart_weight * area)
        self._touch = RobustSum.of("geman_mcclure", GAP_SIGMAS, SIGMA_M, self._touch_weight * area * touches)

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy of the pairs; zero if no vertices are near each other."""
        if not self._is_on:
            return {}
        pairs, energy = self.pairs, torch.zeros_like(bodies.vertices[:, 0, 0])
        if len(pairs):
            energy = PairEnergies.apply(  # type: ignore[no-untyped-call]
                bodies.vertices, pairs, self._apart, self._touch
            )
        return {"people": energy}
