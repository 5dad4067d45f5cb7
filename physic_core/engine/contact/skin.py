"""Signed distances of body vertices to skin: of other people, and of other parts of the own body. Camera frame, metres.

Skin touches only skin that looks another way: the far side of a hand does not touch what its palm touches.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

__all__ = ["OWN_RADIUS_M", "SkinDistances", "own_distances", "people_distances"]

OWN_RADIUS_M = 0.08
"""Search radius on the own body, metres: its parts are off by less than scene and people."""

_SPACING_M = 0.012  # half the largest distance of neighbouring vertices
_CANDIDATES = 6  # nearest vertices among which one of skin that looks another way is searched
_MAX_COSINE = 0.5  # between two normals; skin that looks the same way does not touch
_SAME_SKIN_M = 0.12  # in the rest pose; nearer vertices are one piece of skin


@dataclass(frozen=True)
class SkinDistances:
    """Nearest skin of each vertex of N people.

    Attributes:
        distance: (N, V) signed, along the normal of that skin, metres, negative inside; inf if no skin is within the
            search radius.
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


@dataclass(frozen=True)
class _Bodies:
    """Vertices, normals and outer vertex ids of all people as arrays, and the result so far."""

    vertices: np.ndarray
    normals: np.ndarray
    outer: np.ndarray
    distance: np.ndarray
    person: np.ndarray
    vertex: np.ndarray

    @property
    def finite(self) -> list[int]:
        """People whose vertices are finite."""
        return [i for i, body in enumerate(self.vertices) if np.isfinite(body).all()]

    @staticmethod
    def of(vertices: Tensor, normals: Tensor, outer: Tensor) -> _Bodies:
        points, directions = (t.detach().cpu().double().numpy() for t in (vertices, normals))
        count = points.shape[:2]
        none = np.zeros(count, np.int64)
        return _Bodies(
            points, directions, np.flatnonzero(outer.cpu().numpy()), np.full(count, np.inf), none, none.copy()
        )

    def compare(
        self, i: int, ids: np.ndarray, j: int, targets: np.ndarray, radius: float, rest: np.ndarray | None
    ) -> None:
        """Enter the distances of vertices ``ids`` of person i to ``targets`` of person j, where they are smaller."""
        body, other, outwards = self.vertices[i], self.vertices[j], self.normals[j]
        if not len(targets):
            return
        low, high = other[targets].min(0) - radius, other[targets].max(0) + radius
        ids = ids[((body[ids] > low) & (body[ids] < high)).all(1)]
        if not len(ids):
            return
        count = min(_CANDIDATES, len(targets))
        tree = cKDTree(other[targets], balanced_tree=False, compact_nodes=False)
        gap, index = tree.query(body[ids], k=count, distance_upper_bound=radius)
        gap, index = gap.reshape(len(ids), count), index.reshape(len(ids), count)
        near = np.isfinite(gap[:, 0])
        ids, found, index = ids[near], np.isfinite(gap[near]), index[near]
        nearest = targets[np.where(found, index, 0)]
        offset = body[ids][:, None] - other[nearest]
        along = (offset * outwards[nearest]).sum(-1)
        beside = np.linalg.norm(offset - along[..., None] * outwards[nearest], axis=-1)
        size = np.sqrt(along**2 + np.maximum(beside - _SPACING_M, 0) ** 2)
        found &= (self.normals[i, ids][:, None] * outwards[nearest]).sum(-1) < _MAX_COSINE
        if rest is not None:
            found &= np.linalg.norm(rest[ids][:, None] - rest[nearest], axis=-1) > _SAME_SKIN_M
        size = np.where(found, size, np.inf)
        best = size.argmin(1)
        rows = np.arange(len(ids))
        signed = np.copysign(size[rows, best], along[rows, best])
        closer = np.abs(signed) < np.abs(self.distance[i, ids])
        chosen = ids[closer]
        self.distance[i, chosen], self.person[i, chosen] = signed[closer], j
        self.vertex[i, chosen] = nearest[rows, best][closer]

    def distances(self, like: Tensor) -> SkinDistances:
        """Return the result as tensors."""
        return SkinDistances(
            torch.from_numpy(self.distance).to(like),
            *(torch.from_numpy(index).to(like.device) for index in (self.person, self.vertex)),
        )


def people_distances(vertices: Tensor, normals: Tensor, outer: Tensor, radius: float) -> SkinDistances:
    """Find the nearest skin of other people.

    Args:
        vertices: (N, V, 3) metres.
        normals: (N, V, 3) unit, out of the bodies.
        outer: (V,) bool, vertices that may touch and be touched.
        radius: of the search, metres.
    """
    bodies = _Bodies.of(vertices, normals, outer)
    for i, j in permutations(bodies.finite, 2):
        bodies.compare(i, bodies.outer, j, bodies.outer, radius, None)
    return bodies.distances(vertices)


def own_distances(
    vertices: Tensor, normals: Tensor, outer: Tensor, part: Tensor, rest: Tensor, radius: float
) -> SkinDistances:
    """Find the nearest skin of other parts of the own body.

    Vertices less than 12 cm apart in the rest pose are one piece of skin, and do not touch each other: such as forearm
    and upper arm in a bent elbow.

    Args:
        vertices: (N, V, 3) metres.
        normals: (N, V, 3) unit, out of the bodies.
        outer: (V,) bool, vertices that may touch and be touched.
        part: (V,) int64, body part of each vertex.
        rest: (V, 3) vertices in the rest pose, metres.
        radius: of the search, metres.
    """
    bodies = _Bodies.of(vertices, normals, outer)
    parts, at_rest = part.cpu().numpy()[bodies.outer], rest.detach().cpu().double().numpy()
    for i in bodies.finite:
        for p in np.unique(parts):
            bodies.compare(i, bodies.outer[parts != p], i, bodies.outer[parts == p], radius, at_rest)
    return bodies.distances(vertices)
