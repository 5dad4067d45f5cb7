"""Distances of body vertices to all that they may touch: scene and floor, and skin.

Skin is that of other people, and of other parts of the same body, which meets it by the observer.

A photo shows only the front of an object. Its depth is inferred from the width of its front: at a
pixel ``r`` metres from the silhouette, of an object of half width ``R``, the object is ``2 sqrt(r
(2 R - r))`` thick, like a ball.

The scene is reconstructed without people. A body below the surface of a bed has pressed it down, as
far as beds yield; only what is deeper is an error. The depths of :data:`GIVE_M` are set by hand.
Camera frame, metres.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import torch
from torch import Tensor

from physic_core.engine.contact.parts import SceneParts
from physic_core.engine.skin_contact import SkinContact
from physic_core.geometry.floor import PlaneFit
from physic_core.geometry.neighbors import NearestPointSearch

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
    signed = torch.where(nearest.is_found, torch.where(inside, -magnitude, magnitude), far)
    return SurfaceDistances(signed, height, nearest.index, normals)


@dataclass(frozen=True)
class SkinDistances:
    """Skin that each vertex of N people meets.

    Attributes:
        distance: (N, V) from it, metres; inf if the vertex meets none.
        person: (N, V) int64, index of the person whose skin it is; 0 if there is none.
        vertex: (N, V) int64, the nearest vertex of that person; 0 if there is none.
    """

    distance: Tensor
    person: Tensor
    vertex: Tensor

    @staticmethod
    def of_contacts(vertices: Tensor, skin_contacts: Iterable[SkinContact]) -> SkinDistances:
        """Return the distances of vertices (N, V, 3) that meet skin."""
        distance = torch.full_like(vertices[..., 0], torch.inf)
        person, vertex = torch.zeros(2, *distance.shape, dtype=torch.int64)
        for contact in skin_contacts:
            for i, skin, j, other_skin in (
                (contact.other, contact.other_skin, contact.person, contact.on_own),
                (contact.person, contact.skin, contact.other, contact.on_other),
            ):
                distance[i, skin] = (vertices[i, skin] - vertices[j, other_skin]).norm(dim=-1)
                person[i, skin], vertex[i, skin] = j, other_skin
        return SkinDistances(distance, person, vertex)


@dataclass(frozen=True)
class Distances:
    """Distances of the vertices of N people to everything that they may touch, metres; inf beyond
    the search radius.

    Attributes:
        normals: (N, V, 3) unit, out of the bodies.
        surface: to scene and floor.
        parts: of the scene's points, which ``surface.point`` indexes.
        people_skin: to the skin of other people that they meet.
        own_skin: to the skin of other parts of the same body that they meet.
        skin_contacts: of parts that touch skin by the observer.
    """

    normals: Tensor
    surface: SurfaceDistances
    parts: SceneParts
    people_skin: SkinDistances
    own_skin: SkinDistances
    skin_contacts: tuple[SkinContact, ...] = ()

    @property
    def nearest_is_ground(self) -> Tensor:
        """Vertices (N, V) bool whose nearest point of the scene is of the floor."""
        near = torch.isfinite(self.surface.scene)
        return near & self.parts.ground[self.surface.point] if len(self.parts.ground) else near

    @property
    def by_kind(self) -> Tensor:
        """Signed distances (3, N, V), in the order of :data:`KINDS`, without objects."""
        return torch.stack(
            [self.surface.nearest, self.people_skin.distance, self.own_skin.distance]
        )


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
