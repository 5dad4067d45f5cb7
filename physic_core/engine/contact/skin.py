"""Signed distances of body vertices to skin: of other people, and of other parts of the same body.

Camera frame, metres.

Skin touches only skin that faces another way: the back of a hand does not touch what its palm
touches.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import permutations

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

OWN_RADIUS_M = 0.08
"""Search radius on the same body, metres: its parts have smaller errors than scene and people."""

_SPACING_M = 0.012  # half the largest distance of neighbouring vertices
_CANDIDATES = 6  # nearest vertices among which one of skin that looks another way is searched
_MAX_COSINE = 0.5  # between two normals; skin that looks the same way does not touch
_SAME_SKIN_M = 0.12  # in the rest pose; nearer vertices are one piece of skin


@dataclass(frozen=True)
class SkinDistances:
    """Nearest skin of each vertex of N people.

    Attributes:
        distance: (N, V) signed, along the normal of that skin, metres, negative inside; inf if no
            skin is within the search radius.
        person: (N, V) int64, index of the person whose skin it is; 0 if there is none.
        vertex: (N, V) int64, the nearest vertex of that person; 0 if there is none.
    """

    distance: Tensor
    person: Tensor
    vertex: Tensor

    @staticmethod
    def none(vertices: Tensor) -> SkinDistances:
        """Return the distances of vertices (N, V, 3) where no skin is near."""
        index = torch.zeros(vertices.shape[:2], dtype=torch.int64, device=vertices.device)
        return SkinDistances(torch.full_like(vertices[..., 0], torch.inf), index, index)


def people_distances(
    vertices: Tensor, normals: Tensor, outer: Tensor, radius: float
) -> SkinDistances:
    """Find the nearest skin of other people.

    Args:
        vertices: (N, V, 3) metres.
        normals: (N, V, 3) unit, out of the bodies.
        outer: (V,) bool, vertices that may touch and be touched.
        radius: of the search, metres.
    """
    ids = np.flatnonzero(outer.cpu().numpy())
    searches = [(i, ids, j, ids) for i, j in permutations(_finite_people(vertices), 2)]
    return _nearest_skin(vertices, normals, searches, radius)


def own_distances(
    vertices: Tensor, normals: Tensor, outer: Tensor, part: Tensor, rest: Tensor, radius: float
) -> SkinDistances:
    """Find the nearest skin of other parts of the same body.

    Vertices less than 12 cm apart in the rest pose are one piece of skin, and do not touch each
    other, such as forearm and upper arm in a bent elbow.

    Args:
        vertices: (N, V, 3) metres.
        normals: (N, V, 3) unit, out of the bodies.
        outer: (V,) bool, vertices that may touch and be touched.
        part: (V,) int64, body part of each vertex.
        rest: (V, 3) vertices in the rest pose, metres.
        radius: of the search, metres.
    """
    ids = np.flatnonzero(outer.cpu().numpy())
    parts = part.cpu().numpy()[ids]
    searches = [
        (i, ids[parts != p], i, ids[parts == p])
        for i in _finite_people(vertices)
        for p in np.unique(parts)
    ]
    return _nearest_skin(vertices, normals, searches, radius, rest.detach().cpu().double().numpy())


def _finite_people(vertices: Tensor) -> list[int]:
    """Return the people whose vertices (N, V, 3) are finite."""
    finite: list[int] = torch.isfinite(vertices).flatten(1).all(1).nonzero()[:, 0].tolist()
    return finite


def _nearest_skin(
    vertices: Tensor,
    normals: Tensor,
    searches: Iterable[tuple[int, np.ndarray, int, np.ndarray]],
    radius: float,
    rest: np.ndarray | None = None,
) -> SkinDistances:
    """Return the nearest skin of each vertex over all searches.

    Args:
        vertices: (N, V, 3) metres.
        normals: (N, V, 3) unit, out of the bodies.
        searches: person and vertices that search, person and vertices that are searched.
        radius: of the search, metres.
        rest: (V, 3) vertices in the rest pose, metres, where skin of the same body is searched.
    """
    points, outwards = (t.detach().cpu().double().numpy() for t in (vertices, normals))
    distance = np.full(points.shape[:2], np.inf)
    person = np.zeros(distance.shape, np.int64)
    vertex = np.zeros(distance.shape, np.int64)
    for i, ids, j, targets in searches:
        if not len(targets):
            continue
        low = points[j, targets].min(0) - radius
        high = points[j, targets].max(0) + radius
        ids = ids[((points[i, ids] > low) & (points[i, ids] < high)).all(1)]
        if not len(ids):
            continue
        count = min(_CANDIDATES, len(targets))
        tree = cKDTree(points[j, targets], balanced_tree=False, compact_nodes=False)
        gap, index = tree.query(points[i, ids], k=count, distance_upper_bound=radius)
        gap = gap.reshape(len(ids), count)
        index = index.reshape(len(ids), count)
        near = np.isfinite(gap[:, 0])
        ids = ids[near]
        found = np.isfinite(gap[near])
        index = index[near]
        nearest = targets[np.where(found, index, 0)]
        offset = points[i, ids][:, None] - points[j, nearest]
        outward = outwards[j, nearest]
        along = (offset * outward).sum(-1)
        beside = np.linalg.norm(offset - along[..., None] * outward, axis=-1)
        size = np.sqrt(along**2 + np.maximum(beside - _SPACING_M, 0) ** 2)
        found &= (outwards[i, ids][:, None] * outward).sum(-1) < _MAX_COSINE
        if rest is not None:
            found &= np.linalg.norm(rest[ids][:, None] - rest[nearest], axis=-1) > _SAME_SKIN_M
        size = np.where(found, size, np.inf)
        rows = np.arange(len(ids))
        best = size.argmin(1)
        signed = np.copysign(size[rows, best], along[rows, best])
        closer = np.abs(signed) < np.abs(distance[i, ids])
        chosen = ids[closer]
        distance[i, chosen], person[i, chosen], vertex[i, chosen] = (
            signed[closer],
            j,
            nearest[rows, best][closer],
        )
    others = (torch.from_numpy(array).to(vertices.device) for array in (person, vertex))
    return SkinDistances(torch.from_numpy(distance).to(vertices), *others)
