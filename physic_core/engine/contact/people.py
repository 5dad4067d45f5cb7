"""Signed distances of body vertices to other people. Camera frame, metres."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.geometry.neighbors import NearestPointSearch

__all__ = ["PeopleDistances", "people_distances"]

_SKIN_SPACING_M = 0.012  # half the largest distance of neighbouring vertices


@dataclass(frozen=True)
class PeopleDistances:
    """Nearest other person of each vertex.

    Attributes:
        distance: (N, V) signed, metres, negative inside; inf if no other person is within the search radius.
        person: (N, V) int64, index of that person; 0 if there is none.
        vertex: (N, V) int64, their nearest vertex; 0 if there is none.
    """

    distance: Tensor
    person: Tensor
    vertex: Tensor


def people_distances(vertices: Tensor, normals: Tensor, outer: Tensor, radius: float) -> PeopleDistances:
    """Find the nearest other person of each vertex.

    Args:
        vertices: (N, V, 3) metres.
        normals: (N, V, 3) unit, out of the bodies.
        outer: (V,) bool, vertices that may be touched.
        radius: of the search, metres.
    """
    people, count, _ = vertices.shape
    distance = vertices.new_full((people, count), torch.inf)
    person = torch.zeros(people, count, dtype=torch.int64, device=vertices.device)
    vertex = torch.zeros_like(person)
    skin = outer.nonzero(as_tuple=True)[0]
    low, high = vertices.amin(1) - radius, vertices.amax(1) + radius
    for other in range(people):
        near = ((vertices > low[other]) & (vertices < high[other])).all(-1)
        near[other] = False
        if not bool(near.any()):
            continue
        search = NearestPointSearch(vertices[other, skin], normals[other, skin], radius)
        points = vertices[near]
        nearest = search.query(points)
        offset, normal = points - search.points[nearest.index], search.normals[nearest.index]
        along = (normal * offset).sum(-1)
        beside = (offset - along[:, None] * normal).norm(dim=-1)
        signed = torch.sqrt(along.square() + torch.relu(beside - _SKIN_SPACING_M).square()) * along.sign()
        signed = torch.where(nearest.found, signed, torch.inf)
        closer = torch.zeros_like(near)
        closer[near] = signed.abs() < distance[near].abs()
        chosen = closer[near]
        distance[closer], vertex[closer] = signed[chosen], skin[nearest.index[chosen]]
        person[closer] = other
    return PeopleDistances(distance, person, vertex)
