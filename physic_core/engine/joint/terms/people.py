"""Pairs of vertices of two people that are near each other, and parts that touch each other by what
is observed of both. Camera frame, metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import permutations
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from physic_core.body.joints import JOINT_INDEX
from physic_core.body.model import BodyModel
from physic_core.engine.body_parts import contact_regions
from physic_core.engine.joint.sampling import Sampling
from physic_core.engine.joint.term import PosedBodies, RobustSum, Snapshot, Term
from physic_core.engine.joint.terms.scene_contact import (
    SLACK_M,
    SURFACE_SIGMA_M,
    ContactTermSettings,
    PenetrationSettings,
    robust_depths,
)
from physic_core.engine.skin_contact import SkinContact, find_skin_contacts
from physic_core.engine.state import State
from physic_core.geometry.mesh import cluster_points
from physic_core.geometry.neighbors import NearestPointSearch, inside_body_boxes

_SPACING_M = 0.03  # of the probes
_MAX_BESIDE_M = 0.02  # of a vertex from the normal of its partner: the spacing of the partners
_MAX_SLANT = 0.5  # the same, as a share of the distance along the normal


@dataclass(frozen=True)
class PeoplePairs:
    """p pairs of a probe and the nearest vertex on another person.

    Attributes:
        person: (p,) int64, owner of the probe.
        row: (p,) int64, the probe's row of the subsampled vertices.
        probe: (p,) int64, index of the probe.
        other: (p,) int64, owner of the nearest vertex.
        other_row: (p,) int64, its row of the subsampled vertices.
        normal: (p, 3) unit, of the nearest vertex, out of its body.
        distance: (p,) along that normal, metres, negative inside the other body.
    """

    person: Tensor
    row: Tensor
    probe: Tensor
    other: Tensor
    other_row: Tensor
    normal: Tensor
    distance: Tensor

    def __len__(self) -> int:
        return len(self.person)

    def select(self, rows: Tensor) -> PeoplePairs:
        """Return some of the pairs, selected by a mask (p,) or by indices."""
        return PeoplePairs(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})


def select_probes(model: BodyModel, ids: Tensor, area: Tensor) -> tuple[Tensor, Tensor]:
    """Select the vertices that are compared with the skin of other people: one per 3 cm cell and
    body part in the T-pose.

    Args:
        ids: (n,) int64, the subsampled vertices.
        area: (B, n) of these.

    Returns:
        Rows (m,) int64 of the n vertices, and summed area (B, m) of the group of each.
    """
    part = model.part_of_vertex[ids]
    rest = model(*model.zero_pose(1), vertex_ids=ids).vertices[0]
    group, rows = cluster_points(rest, part, _SPACING_M)
    return rows, area.new_zeros(len(area), len(rows)).index_add(1, group, area)


@torch.no_grad()
def find_people_pairs(
    probes: Tensor, vertices: Tensor, normals: Tensor, reach: float
) -> PeoplePairs:
    """Find the nearest vertex of each probe on each other person.

    A probe whose own normal does not oppose that of the nearest vertex has no pair there: the far
    side of a limb that is inside another body would be pulled deeper.

    Args:
        probes: (m,) int64, rows of the vertices.
        vertices: (B, n, 3) subsampled vertices, metres.
        normals: (B, n, 3) unit, out of the bodies.
        reach: largest distance of a pair, metres.
    """
    low = vertices.amin(1) - reach
    high = vertices.amax(1) + reach
    close = ((low[:, None] < high) & (low < high[:, None])).all(-1).tolist()
    people = [(i, j) for i, j in permutations(range(len(vertices)), 2) if close[i][j]]
    pairs = [_nearest(i, j, probes, vertices, reach) for i, j in people]
    person, probe, other, other_row = torch.cat([probes.new_zeros(4, 0), *pairs], 1)
    row = probes[probe]
    normal = normals[other, other_row]
    offset = vertices[person, row] - vertices[other, other_row]
    along = (offset * normal).sum(-1)
    beside = (offset - along[:, None] * normal).norm(dim=-1)
    opposed = (normals[person, row] * normal).sum(-1) < 0
    kept = (beside < (_MAX_SLANT * along.abs()).clamp(min=_MAX_BESIDE_M)) & opposed
    return PeoplePairs(person, row, probe, other, other_row, normal, along).select(kept)


def connected_groups(links: Tensor, people: int) -> Tensor:
    """Return the group (people,) int64 of each person: the smallest index of those connected by
    links (k, 2).
    """
    group = list(range(people))
    for a, b in torch.unique(links, dim=0).tolist():
        first, second = sorted((group[a], group[b]))
        group = [first if one == second else one for one in group]
    return torch.tensor(group)


def _nearest(i: int, j: int, probes: Tensor, vertices: Tensor, reach: float) -> Tensor:
    """Return person i, probes of this person, person j, and their nearest rows of person j: (4, p)
    int64.
    """
    points = vertices[i, probes]
    body = vertices[j]
    rows = inside_body_boxes(body, points[None], reach).nonzero(as_tuple=True)[0]
    if not len(rows):
        return rows.new_zeros(4, 0)
    skin = body[rows]
    chosen = inside_body_boxes(points, skin[None], reach).nonzero(as_tuple=True)[0]
    nearest = NearestPointSearch(skin, torch.zeros_like(skin), reach).query(points[chosen])
    probe = chosen[nearest.is_found]
    other_row = rows[nearest.index[nearest.is_found]]
    return torch.stack([torch.full_like(probe, i), probe, torch.full_like(probe, j), other_row])


class PairEnergies(torch.autograd.Function):
    """Energy of each person (B,), with analytic derivatives by the vertices (B, n, 3).

    ``sum_p apart(max(0, -d - slack)) + touch(max(0, d))`` with the distance d of a pair along the
    normal of the other body, negative inside it. The overhead of autograd for these small arrays
    exceeds their cost.
    """

    @staticmethod
    def forward(
        ctx: Any, vertices: Tensor, pairs: PeoplePairs, apart: RobustSum, touch: RobustSum
    ) -> Tensor:
        count = vertices.shape[1]
        flat = vertices.reshape(-1, 3)
        rows = pairs.person * count + pairs.row
        other_rows = pairs.other * count + pairs.other_row
        distance = ((flat[rows] - flat[other_rows]) * pairs.normal).sum(-1)
        inside, by_inside = apart.values_and_slopes(torch.relu(-distance - SLACK_M))
        gap, by_gap = touch.values_and_slopes(torch.relu(distance))
        ctx.vertices = vertices.shape
        ctx.rows = rows
        ctx.other_rows = other_rows
        ctx.pairs = pairs
        ctx.slope = by_gap - by_inside
        return vertices.new_zeros(len(vertices)).index_add(0, pairs.person, inside + gap)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        force = (gradients[0][ctx.pairs.person] * ctx.slope)[:, None] * ctx.pairs.normal
        by_vertex = force.new_zeros(ctx.vertices).reshape(-1, 3)
        by_vertex.index_add_(0, ctx.rows, force).index_add_(0, ctx.other_rows, -force)
        return by_vertex.reshape(ctx.vertices), None, None, None


_REACH_M = 0.06  # of the search, for vertices that are deep inside
_MAX_GAP_M = 0.04  # of hands that may touch
_NEARLY_INSIDE_M = 0.02  # other vertices are not expected to come inside before the next refresh
_GAP_SIGMAS = 1.5  # of the penetration term; beyond as many a gap counts as an outlier


class PeopleTerm(Term):
    """People term: pairs are found at each refresh, and kept until the next one.

    Attributes:
        pairs: p pairs of vertices near each other, since the last refresh.
        apart: robust sum (p,) over depths inside the other body.
        touch: robust sum (p,) over gaps.

    Args:
        contact: its weights are used.
        penetration: its weights are used.
        context: constants of the optimisation.
    """

    def __init__(
        self, contact: ContactTermSettings, penetration: PenetrationSettings, sampling: Sampling
    ) -> None:
        self._touch_weight = contact.weight * contact.people_weight
        self._apart_weight = penetration.weight * penetration.people_weight
        self.pairs: PeoplePairs
        self.apart: RobustSum
        self.touch: RobustSum
        model = sampling.state.model
        self._probes, self._area = select_probes(model, sampling.ids, sampling.area)
        self._may_touch = sampling.on_visible_part & model.part_mask("hand")[sampling.ids]

    @property
    def links(self) -> Tensor:
        """Pairs (p, 2) int64 of people with vertices near each other."""
        return torch.stack([self.pairs.person, self.pairs.other], 1)

    def refresh(self, snapshot: Snapshot) -> None:
        """Find the pairs of vertices near each other, and those that touch."""
        pairs = find_people_pairs(
            self._probes, snapshot.vertices, snapshot.visibility.normals, _REACH_M
        )
        touches = self._may_touch[pairs.person, pairs.row] & (pairs.distance < _MAX_GAP_M)
        kept = touches | (pairs.distance < _NEARLY_INSIDE_M)
        self.pairs = pairs.select(kept)
        touches = touches[kept]
        area = self._area[self.pairs.person, self.pairs.probe]
        self.apart = robust_depths(self._apart_weight * area)
        self.touch = RobustSum(
            "geman_mcclure", _GAP_SIGMAS, SURFACE_SIGMA_M, self._touch_weight * area * touches
        )

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy of the pairs; zero if no vertices are near each other."""
        energy = PairEnergies.apply(  # type: ignore[no-untyped-call]
            bodies.vertices, self.pairs, self.apart, self.touch
        )
        return {"people": energy}


_MEETING_WEIGHT = 2500.0  # of a gap as large as the errors of both parts: these close it
_PAIRS = 8  # nearest pairs of vertices of two parts, which share the weight
_LEAST_GAP_M = 0.005  # between vertices of skin that touches
_LIMB_SIGMA_M = 0.1  # error of a joint whose body estimator states none
_JOINT = {"hand": "wrist", "lower_arm": "elbow", "foot": "ankle", "lower_leg": "knee"}


def mutual_skin_contacts(sampling: Sampling) -> tuple[SkinContact, ...]:
    """Return the parts of people that touch each other at the start by what is observed of both,
    each pair once.
    """
    pairs = find_skin_contacts(
        sampling.state.model, sampling.start.vertices, sampling.state.observed_touch
    )
    ends = {(one.person, one.part): (one.other, one.other_part) for one in pairs}
    return tuple(
        one
        for one in pairs
        if ends.get((one.other, one.other_part)) == (one.person, one.part)
        and (one.person, one.part) < (one.other, one.other_part)
    )


class SkinContactTerm(Term):
    """Gaps between parts that touch each other: squared distances of the nearest vertices, in units
    of the errors of both parts.

    Attributes:
        skin_contacts: the pairs of parts.

    Args:
        skin_contacts: the pairs of parts.
        sampling: constants of the optimisation.
    """

    def __init__(self, skin_contacts: Sequence[SkinContact], sampling: Sampling) -> None:
        self.skin_contacts = tuple(skin_contacts)
        model = sampling.state.model
        names, region = contact_regions(model)
        part = torch.where(model.outer, region, -1)[sampling.ids]
        self._rows = [
            [(part == names.index(name)).nonzero()[:, 0] for name in (one.part, one.other_part)]
            for one in self.skin_contacts
        ]
        self._weights = sampling.area.new_tensor(
            [
                _MEETING_WEIGHT * one.probability / _variance(sampling.state, one)
                for one in self.skin_contacts
            ]
        )
        self._skin: Tensor

    @property
    def links(self) -> Tensor:
        """The people (p, 2) int64 of each pair."""
        return torch.tensor([[one.person, one.other] for one in self.skin_contacts])

    def refresh(self, snapshot: Snapshot) -> None:
        """Find the nearest vertices of each pair of parts."""
        vertices = snapshot.vertices
        count = vertices.shape[1]
        ends = []
        for one, (own, other) in zip(self.skin_contacts, self._rows, strict=True):
            skin, target = vertices[one.person, own], vertices[one.other, other]
            gap, nearest = torch.cdist(skin, target).min(1)
            chosen = gap.topk(_PAIRS, largest=False).indices
            ends.append(one.person * count + own[chosen])
            ends.append(one.other * count + other[nearest[chosen]])
        self._skin = torch.cat(ends)

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy, half for each of both people."""
        people = len(bodies.vertices)
        # one selection, since the derivative of each is as large as all vertices
        skin = bodies.vertices.flatten(0, 1).index_select(0, self._skin)
        own, other = skin.view(-1, 2, _PAIRS, 3).unbind(1)
        gap = torch.relu((own - other).norm(dim=-1) - _LEAST_GAP_M)
        half = (self._weights * gap.square().mean(1)).repeat_interleave(2) / 2
        links = self.links.flatten()
        return {"meeting": half.new_zeros(people).index_add(0, links, half)}


def _variance(state: State, meeting: SkinContact) -> float:
    """Return the variance of the distance of two parts, square metres."""
    return sum(
        _limb_sigma(state, person, part) ** 2
        for person, part in (
            (meeting.person, meeting.part),
            (meeting.other, meeting.other_part),
        )
    )


def _limb_sigma(state: State, person: int, part: str) -> float:
    """Return the error of the place of a part, metres."""
    side, _, limb = part.partition("_")
    joint = f"{side}_{_JOINT[limb]}" if limb in _JOINT else "pelvis"
    sigma = (
        0.0 if state.joint_sigma is None else float(state.joint_sigma[person, JOINT_INDEX[joint]])
    )
    return sigma if sigma > 0 else _LIMB_SIGMA_M
