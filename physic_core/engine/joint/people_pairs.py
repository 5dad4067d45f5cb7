"""Pairs of vertices of two people that are near each other. Camera frame, metres."""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import permutations

import torch
from torch import Tensor

from physic_core.body.model import BodyModel
from physic_core.geometry.coarse_mesh import cluster_points
from physic_core.geometry.neighbors import NearestPointSearch, inside_body_boxes

_SPACING_M = 0.03  # of the probes
_MAX_BESIDE_M = 0.02  # of a vertex from the normal of its partner: the spacing of the partners
_MAX_SLANT = 0.5  # the same, as a share of the distance along the normal


@dataclass(frozen=True)
class PeopleProbes:
    """Vertices compared with the skin of other people.

    Attributes:
        rows: (m,) int64, into the n subsampled vertices.
        area: (B, m) surface per probe, in the unit of the vertices' areas.
    """

    rows: Tensor
    area: Tensor


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


def select_probes(model: BodyModel, ids: Tensor, area: Tensor) -> PeopleProbes:
    """Select one vertex per 3 cm cell and body part in the T-pose, with the summed area of its group.

    Args:
        ids: (n,) int64, the subsampled vertices.
        area: (B, n) of these.
    """
    part = model.part_of_vertex[ids]
    rest = model(*model.zero_pose(1), vertex_ids=ids).vertices[0]
    group, rows = cluster_points(rest, part, _SPACING_M)
    return PeopleProbes(rows, area.new_zeros(len(area), len(rows)).index_add(1, group, area))


@torch.no_grad()
def find_people_pairs(probes: PeopleProbes, vertices: Tensor, normals: Tensor, reach: float) -> PeoplePairs:
    """Find the nearest vertex of each probe on each other person.

    A probe whose own normal does not oppose that of the nearest vertex has no pair there: the far side of a limb that
    is inside another body would be pulled deeper.

    Args:
        vertices: (B, n, 3) subsampled vertices, metres.
        normals: (B, n, 3) unit, out of the bodies.
        reach: largest distance of a pair, metres.
    """
    low, high = vertices.amin(1) - reach, vertices.amax(1) + reach
    close = ((low[:, None] < high) & (low < high[:, None])).all(-1).tolist()
    people = [(i, j) for i, j in permutations(range(len(vertices)), 2) if close[i][j]]
    pairs = [_nearest(i, j, probes, vertices, reach) for i, j in people]
    person, probe, other, other_row = torch.cat([probes.rows.new_zeros(4, 0), *pairs], 1)
    row = probes.rows[probe]
    normal = normals[other, other_row]
    offset = vertices[person, row] - vertices[other, other_row]
    along = (offset * normal).sum(-1)
    beside = (offset - along[:, None] * normal).norm(dim=-1)
    opposed = (normals[person, row] * normal).sum(-1) < 0
    kept = (beside < (_MAX_SLANT * along.abs()).clamp(min=_MAX_BESIDE_M)) & opposed
    return PeoplePairs(person, row, probe, other, other_row, normal, along).select(kept)


def connected_groups(links: Tensor, people: int) -> Tensor:
    """Return the group (people,) int64 of each person: the smallest index of those connected by links (k, 2)."""
    group = list(range(people))
    for a, b in torch.unique(links, dim=0).tolist():
        first, second = sorted((group[a], group[b]))
        group = [first if one == second else one for one in group]
    return torch.tensor(group)


def _nearest(i: int, j: int, probes: PeopleProbes, vertices: Tensor, reach: float) -> Tensor:
    """Return person i, probes of this person, person j, and their nearest rows of person j: (4, p) int64."""
    points, body = vertices[i, probes.rows], vertices[j]
    rows = inside_body_boxes(body, points[None], reach).nonzero(as_tuple=True)[0]
    if not len(rows):
        return rows.new_zeros(4, 0)
    skin = body[rows]
    chosen = inside_body_boxes(points, skin[None], reach).nonzero(as_tuple=True)[0]
    nearest = NearestPointSearch(skin, torch.zeros_like(skin), reach).query(points[chosen])
    probe, other_row = chosen[nearest.found], rows[nearest.index[nearest.found]]
    return torch.stack([torch.full_like(probe, i), probe, torch.full_like(probe, j), other_row])
