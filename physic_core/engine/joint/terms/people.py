"""People term: people touch each other without being inside each other.

The paper's scene has no people, so nothing in it keeps two bodies apart.
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
from physic_core.engine.joint.terms.contact import ContactTermSettings
from physic_core.engine.joint.terms.penetration import SLACK_M, SURFACE_SIGMA_M, PenetrationSettings, robust_depths

_TOUCHING_PARTS = ("left_hand", "right_hand")
_REACH_M = 0.06  # of the search, for vertices that are deep inside
_MAX_GAP_M = 0.04  # of hands that may touch
_NEARLY_INSIDE_M = 0.02  # other vertices are not expected to come inside before the next refresh
_GAP_SIGMAS = 1.5  # of the penetration term; beyond as many a gap counts as an outlier


class PairEnergies(torch.autograd.Function):
    """Energy of each person (B,), with analytic derivatives by the vertices (B, n, 3).

    ``sum_p apart(max(0, -d - slack)) + touch(max(0, d))`` with the distance d of a pair along the normal of the other
    body, negative inside it. The overhead of autograd for these small arrays exceeds their cost.
    """

    @staticmethod
    def forward(ctx: Any, vertices: Tensor, pairs: PeoplePairs, apart: RobustSum, touch: RobustSum) -> Tensor:
        count = vertices.shape[1]
        flat, rows = vertices.reshape(-1, 3), pairs.person * count + pairs.row
        other_rows = pairs.other * count + pairs.other_row
        distance = ((flat[rows] - flat[other_rows]) * pairs.normal).sum(-1)
        inside, by_inside = apart.values_and_slopes(torch.relu(-distance - SLACK_M))
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
        contact: its weights are used.
        penetration: its weights are used.
        context: constants of the optimisation.
    """

    def __init__(self, contact: ContactTermSettings, penetration: PenetrationSettings, context: JointContext) -> None:
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
        return torch.stack([self.pairs.person, self.pairs.other], 1) if self._is_on else super().links

    def refresh(self, snapshot: Snapshot) -> None:
        """Find the pairs of vertices near each other, and those that touch."""
        if not self._is_on:
            return
        found = find_people_pairs(self._probes, snapshot.vertices, snapshot.visibility.normals, _REACH_M)
        touches = self._may_touch[found.person, found.row] & (found.distance < _MAX_GAP_M)
        kept = touches | (found.distance < _NEARLY_INSIDE_M)
        self.pairs, touches = found.select(kept), touches[kept]
        area = self._probes.area[self.pairs.person, self.pairs.probe]
        self._apart = robust_depths(self._apart_weight * area)
        self._touch = RobustSum.of("geman_mcclure", _GAP_SIGMAS, SURFACE_SIGMA_M, self._touch_weight * area * touches)

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
