"""Distances of body vertices to all that they may touch: scene and floor, and skin.

Skin is that of other people, and of other parts of the same body. It touches only skin that faces
another way: the back of a hand does not touch what its palm touches.

A photo shows only the front of an object. Its depth is inferred from the width of its front: at a
pixel ``r`` metres from the silhouette, of an object of half width ``R``, the object is ``2 sqrt(r
(2 R - r))`` thick, like a ball.

The scene is reconstructed without people. A body below the surface of a bed has pressed it down, as
far as beds yield; only what is deeper is an error. The depths of :data:`GIVE_M` are set by hand.
Camera frame, metres.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import torch
from torch import Tensor

from physic_core.engine.contact.parts import SceneParts
from physic_core.engine.whom import Meeting
from physic_core.geometry.floor import PlaneFit
from physic_core.geometry.neighbors import NearestPointSearch, array_tree
from physic_core.geometry.tensors import exact_arrays

KINDS = ("scene", "person", "own body", "object")
"""What a vertex may touch; floor and scene are one kind. An object has no distance."""

HAND_BREADTH_M = 0.1
"""Largest distance of skin from what it touches, metres: the errors of poses and scenes."""

SEARCH_RADIUS_M = 0.15
"""Search radius, metres: larger distances are reported as inf.

The contact thresholds of all presets are smaller.
"""

DistanceMeasure: TypeAlias = Callable[[Tensor, Tensor, Tensor], Tensor]
"""Function that returns distances (...) of vertices, metres.

Its arguments: the offsets (..., 3) from the nearest scene points, the normals (..., 3) of these
points, zero where unknown, and the lengths (...) of the offsets.
"""


@dataclass(frozen=True)
class ContactSurfaces:
    """Surfaces that bodies may touch.

    Attributes:
        scene: scaled scene points near bodies, and samples of the floor if the method uses them.
        row: (n,) int64, row of each of these points in ``Surroundings.points``; -1 for
            samples of the floor.
        floor: None without a plane, or if its samples are in ``scene``.
    """

    scene: NearestPointSearch
    row: Tensor
    floor: PlaneFit | None


@dataclass(frozen=True)
class SurfaceDistances:
    """Signed distances of vertices to scene and floor, metres: negative inside, inf beyond the
    search radius.

    Attributes:
        scene: (..., V).
        floor: (..., V); inf without a plane.
        point: (..., V) int64, nearest point of ``ContactSurfaces.scene``; 0 if none is within the
            search radius.
        normals: (..., V, 3) unit, of these points; zero where unknown.
    """

    scene: Tensor
    floor: Tensor
    point: Tensor
    normals: Tensor

    @property
    def nearest(self) -> Tensor:
        """Signed distance (..., V) to the nearer of scene and floor."""
        return torch.where(self.floor_is_nearer, self.floor, self.scene)

    @property
    def floor_is_nearer(self) -> Tensor:
        """Vertices (..., V) bool that are nearer to the floor's plane than to the scene."""
        return self.floor.abs() < self.scene.abs()


def surface_distances(
    vertices: Tensor,
    surfaces: ContactSurfaces,
    measure: DistanceMeasure,
    free: Tensor | None = None,
) -> SurfaceDistances:
    """Return the signed distances of vertices (..., V, 3), metres, to scene and floor.

    The distance is positive at points without a normal, and for vertices in free space, ``free``
    (..., V) bool, see :mod:`physic_core.geometry.visibility`.
    """
    scene = surfaces.scene
    nearest = scene.query(vertices, radius=SEARCH_RADIUS_M)
    far = torch.full_like(nearest.distance, torch.inf)
    height = far
    if surfaces.floor is not None:
        height = surfaces.floor.height(vertices)
        height = torch.where(height.abs() < SEARCH_RADIUS_M, height, far)
    if not len(scene.points):
        return SurfaceDistances(far, height, nearest.index, torch.zeros_like(vertices))
    normals = scene.normals[nearest.index].to(vertices)
    offsets = vertices - scene.points[nearest.index]
    along = (normals * offsets).sum(-1)
    inside = along < 0 if free is None else (along < 0) & ~free
    magnitude = measure(offsets, normals, nearest.distance)
    signed = torch.where(nearest.found, torch.where(inside, -magnitude, magnitude), far)
    return SurfaceDistances(signed, height, nearest.index, normals)


# Search radius on the same body: its parts have smaller errors than scene and people.
_OWN_RADIUS_M = 0.08
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


def people_distances(vertices: Tensor, normals: Tensor, outer: Tensor) -> SkinDistances:
    """Find the nearest skin of other people.

    Args:
        vertices: (N, V, 3) metres.
        normals: (N, V, 3) unit, out of the bodies.
        outer: (V,) bool, vertices that may touch and be touched.
    """
    (ids,) = exact_arrays(outer.nonzero()[:, 0])
    people = _finite_people(vertices)
    searches = [(j, ids, [(i, ids) for i in people if i != j]) for j in people]
    return _nearest_skin(vertices, normals, searches, SEARCH_RADIUS_M)


def own_distances(
    vertices: Tensor, normals: Tensor, outer: Tensor, part: Tensor, rest: Tensor
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
    """
    ids, parts, at_rest = exact_arrays(outer.nonzero()[:, 0], part[outer], rest)
    searches = [
        (i, ids[parts == p], [(i, ids[parts != p])])
        for i in _finite_people(vertices)
        for p in np.unique(parts)
    ]
    return _nearest_skin(vertices, normals, searches, _OWN_RADIUS_M, at_rest)


def _finite_people(vertices: Tensor) -> list[int]:
    """Return the people whose vertices (N, V, 3) are finite."""
    finite: list[int] = torch.isfinite(vertices).flatten(1).all(1).nonzero()[:, 0].tolist()
    return finite


def at_meetings(
    skin: SkinDistances, vertices: Tensor, meetings: Sequence[Meeting]
) -> SkinDistances:
    """Return the distances with those of vertices (N, V, 3) that meet other skin from it."""
    distance, person, vertex = skin.distance.clone(), skin.person.clone(), skin.vertex.clone()
    for one in meetings:
        for i, own, j, other in (
            (one.other, one.other_skin, one.person, one.on_own),
            (one.person, one.skin, one.other, one.on_other),
        ):
            same = (person[i, own] == j) & (vertex[i, own] == other)
            apart = (vertices[i, own] - vertices[j, other]).norm(dim=-1)
            distance[i, own] = torch.where(same, distance[i, own], apart)
            person[i, own], vertex[i, own] = j, other
    return SkinDistances(distance, person, vertex)


_Skin: TypeAlias = tuple[int, np.ndarray]
"""A person, and (n,) vertices."""


def _nearest_skin(
    vertices: Tensor,
    normals: Tensor,
    searches: Iterable[tuple[int, np.ndarray, Sequence[_Skin]]],
    radius: float,
    rest: np.ndarray | None = None,
) -> SkinDistances:
    """Return the nearest skin of each vertex over all searches.

    Args:
        vertices: (N, V, 3) metres.
        normals: (N, V, 3) unit, out of the bodies.
        searches: person and vertices that are searched; people and their vertices that search them.
        radius: of the search, metres.
        rest: (V, 3) vertices in the rest pose, metres, where skin of the same body is searched.
    """
    points, outwards = exact_arrays(vertices, normals)
    distance = np.full(points.shape[:2], np.inf)
    person = np.zeros(distance.shape, np.int64)
    vertex = np.zeros(distance.shape, np.int64)
    for j, targets, searchers in searches:
        for i, ids, nearest, found in _neighbours(points, (j, targets), searchers, radius):
            outward = outwards[j, nearest]
            found &= (outwards[i, ids][:, None] * outward).sum(-1) < _MAX_COSINE
            if rest is not None:
                found &= np.linalg.norm(rest[ids][:, None] - rest[nearest], axis=-1) > _SAME_SKIN_M
            offset = points[i, ids][:, None] - points[j, nearest]
            signed, best = _signed_distances(offset, outward, found)
            closer = np.abs(signed) < np.abs(distance[i, ids])
            chosen = ids[closer]
            distance[i, chosen] = signed[closer]
            person[i, chosen] = j
            vertex[i, chosen] = nearest[np.arange(len(ids)), best][closer]
    near, *others = (
        torch.from_numpy(each).to(vertices.device) for each in (distance, person, vertex)
    )
    return SkinDistances(near.to(vertices), *others)


def _neighbours(
    points: np.ndarray, searched: _Skin, searchers: Iterable[_Skin], radius: float
) -> Iterator[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
    """Yield each person with vertices near the skin of another, these n vertices, the k vertices
    (n, k) of that skin nearest to each, and which of them (n, k) bool are within the radius.

    Args:
        points: (N, V, 3) metres.
        searched: the other person, and the vertices of the skin.
        searchers: people, and their vertices.
        radius: of the search, metres.
    """
    other, targets = searched
    if not len(targets):
        return
    skin = points[other, targets]
    low = skin.min(0) - radius
    high = skin.max(0) + radius
    count = min(_CANDIDATES, len(targets))
    tree = None
    for i, candidates in searchers:
        inside = ((points[i, candidates] > low) & (points[i, candidates] < high)).all(1)
        ids = candidates[inside]
        if not len(ids):
            continue
        tree = tree or array_tree(skin)
        gap, index = tree.query(points[i, ids], k=count, distance_upper_bound=radius)
        found = np.isfinite(gap.reshape(len(ids), count))
        nearest = targets[np.where(found, index.reshape(found.shape), 0)]
        near = found[:, 0]
        yield i, ids[near], nearest[near], found[near]


def _signed_distances(
    offset: np.ndarray, outward: np.ndarray, found: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the smallest distance (n,) of n vertices from k pieces of skin, signed along its
    normal, and the piece (n,) int64; inf if none is found.

    Args:
        offset: (n, k, 3) from the skin, metres.
        outward: (n, k, 3) unit, out of the skin.
        found: (n, k) bool.
    """
    along = (offset * outward).sum(-1)
    beside = np.linalg.norm(offset - along[..., None] * outward, axis=-1)
    size = np.sqrt(along**2 + np.maximum(beside - _SPACING_M, 0) ** 2)
    size = np.where(found, size, np.inf)
    best = size.argmin(1)
    rows = np.arange(len(best))
    return np.copysign(size[rows, best], along[rows, best]), best


@dataclass(frozen=True)
class Distances:
    """Distances of the vertices of N people to everything that they may touch, metres; inf beyond
    the search radius.

    Attributes:
        normals: (N, V, 3) unit, out of the bodies.
        surface: to scene and floor.
        parts: of the scene's points, which ``surface.point`` indexes.
        people: to the skin of other people.
        own: to the skin of other parts of the same body.
        meetings: of parts that touch skin by the observer. Where their vertices touch, ``people``
            and ``own`` are to the part that they meet, however far it is.
    """

    normals: Tensor
    surface: SurfaceDistances
    parts: SceneParts
    people: SkinDistances
    own: SkinDistances
    meetings: tuple[Meeting, ...] = ()

    @property
    def nearest_is_ground(self) -> Tensor:
        """Vertices (N, V) bool whose nearest point of the scene is of the floor."""
        near = torch.isfinite(self.surface.scene)
        return near & self.parts.ground[self.surface.point] if len(self.parts.ground) else near

    @property
    def by_kind(self) -> Tensor:
        """Signed distances (3, N, V), in the order of :data:`KINDS`, without objects."""
        return torch.stack([self.surface.nearest, self.people.distance, self.own.distance])


GIVE_M: Mapping[str, float] = {
    "bed": 0.10,
    "seat": 0.08,
    "vegetation": 0.05,
    "ground": 0.03,
    "rug": 0.02,
}
"""Class of :data:`physic_core.types.SURFACE_NAMES` -> largest depth of a dent, metres.

"ground" may be sand or grass. Surfaces of all other classes, and those of unknown class, do not
yield.
"""


def dent_depths(near: SurfaceDistances, parts: SceneParts) -> Tensor:
    """Return how deep vertices press into yielding surfaces, metres: (N, V), NaN elsewhere."""
    if not len(parts.label):
        return torch.full_like(near.scene, torch.nan)
    table = near.scene.new_tensor([0.0, *(GIVE_M.get(name, 0.0) for name in parts.names)])
    give = torch.where(torch.isfinite(near.scene), table[parts.label + 1][near.point], 0.0)
    return torch.where(give > 0, torch.minimum(torch.relu(-near.scene), give), torch.nan)
