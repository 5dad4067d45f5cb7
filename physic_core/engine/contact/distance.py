"""Signed distances of body vertices to scene and floor, and the published contact rule. Camera frame, metres."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.distances import plane_height
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.settings import ContactSettings, EngineSettings
from physic_core.geometry.neighbors import NearestPointSearch, inside_body_boxes

__all__ = [
    "SEARCH_RADIUS_M",
    "ContactSurfaces",
    "SurfaceDistances",
    "contact_map",
    "contact_surfaces",
    "surface_distance",
    "surface_distances",
]

SEARCH_RADIUS_M = 0.15
"""Search radius, metres: larger distances are reported as inf. The contact thresholds of all presets are smaller."""

_POINT_SPACING_M = 0.02  # of scene points: a vertex between four of them is on the surface, not 1 cm from it


@dataclass(frozen=True)
class ContactSurfaces:
    """Surfaces that bodies may touch.

    Attributes:
        scene: scaled scene points near bodies, and samples of the floor if stage 3 uses them.
        row: (n,) int64, row of each of these points in ``JointProblem.scene_points``; -1 for samples of the floor.
        floor: unit normal (3,) and offset in metres; None without a plane, or if its samples are in ``scene``.
    """

    scene: NearestPointSearch
    row: Tensor
    floor: tuple[Tensor, float] | None


@dataclass(frozen=True)
class SurfaceDistances:
    """Signed distances of vertices to scene and floor, metres: negative inside, inf beyond the search radius.

    Attributes:
        scene: (..., V).
        floor: (..., V); inf without a plane.
        point: (..., V) int64, nearest point of ``ContactSurfaces.scene``; 0 if none is within the search radius.
    """

    scene: Tensor
    floor: Tensor
    point: Tensor

    @property
    def nearest(self) -> Tensor:
        """Signed distance (..., V) to the nearer of scene and floor."""
        return torch.where(self.on_floor, self.floor, self.scene)

    @property
    def on_floor(self) -> Tensor:
        """Vertices (..., V) bool to which the floor's plane is nearer than the scene."""
        return self.floor.abs() < self.scene.abs()


def contact_map(
    vertices: Tensor,
    scene: NearestPointSearch,
    floor: tuple[Tensor, float] | None,
    outer: Tensor,
    settings: ContactSettings,
    free: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """Compute contact by distance, as published, and signed distance of each vertex.

    Args:
        vertices: (..., V, 3) metres, camera frame.
        scene: scaled points and normals of the scene; its radius limits the distances.
        floor: unit normal (3,) and offset in metres; None if there is no floor.
        outer: (V,) or (..., V) bool, vertices that may be in contact: False inside mouth and eyes.
        settings: ``distance_m`` and ``inside_m`` bound the distance of a vertex in contact.
        free: (..., V) bool, as in :func:`surface_distance`.

    Returns:
        contact: (..., V) bool.
        distance: (..., V) metres, negative inside; inf if scene and floor are beyond the search radius.
    """
    distance = surface_distances(vertices, scene, floor, settings, free).nearest
    contact = (distance <= settings.distance_m) & (distance >= -settings.inside_m) & outer
    return contact, distance


def contact_surfaces(
    problem: JointProblem, vertices: Tensor, scale: float, settings: EngineSettings
) -> ContactSurfaces:
    """Return the surfaces for contact: the scaled scene near bodies (B, V, 3), and the floor's plane.

    If stage 3 uses samples of the floor, they are among the scene's points, and the plane is None.
    """
    points, normals = problem.scene_points * scale, problem.scene_normals
    row = torch.arange(len(points), device=points.device)
    plane = None if problem.floor_normal is None else (problem.floor_normal, problem.floor_offset * scale)
    if plane is not None and problem.floor_points is not None and settings.joint.energy_options.floor_samples:
        points = torch.cat([points, problem.floor_points * scale])
        normals = torch.cat([normals, plane[0].expand_as(problem.floor_points)])
        row = torch.cat([row, row.new_full((len(problem.floor_points),), -1)])
        plane = None
    near = inside_body_boxes(points, vertices, SEARCH_RADIUS_M)
    return ContactSurfaces(NearestPointSearch(points[near], normals[near], SEARCH_RADIUS_M), row[near], plane)


def surface_distances(
    vertices: Tensor,
    scene: NearestPointSearch,
    floor: tuple[Tensor, float] | None,
    settings: ContactSettings,
    free: Tensor | None = None,
) -> SurfaceDistances:
    """Return the signed distances of vertices (..., V, 3) to scene and floor; arguments as in :func:`contact_map`.

    The metric "plane" measures along the normal of the nearest point, and adds the lateral distance beyond the rim of a
    surface. The distance is positive at points without a normal, and for vertices in free space, ``free`` (..., V)
    bool, see :mod:`physic_core.geometry.free_space`.
    """
    nearest = scene.query(vertices, radius=SEARCH_RADIUS_M)
    far = torch.full_like(nearest.distance, torch.inf)
    height = far
    if floor is not None:
        normal, offset = floor
        height = plane_height(vertices, normal.to(vertices), vertices.new_tensor(offset))
        height = torch.where(height.abs() < SEARCH_RADIUS_M, height, far)
    if not len(scene.points):
        return SurfaceDistances(far, height, nearest.index)
    normals = scene.normals[nearest.index].to(vertices)
    offsets = vertices - scene.points[nearest.index]
    along = (normals * offsets).sum(-1)
    inside = along < 0 if free is None else (along < 0) & ~free
    magnitude = nearest.distance
    if settings.metric == "plane":
        beside = (offsets - along[..., None] * normals).norm(dim=-1)
        known = normals.square().sum(-1) > 0.5
        plane = torch.sqrt(along.square() + torch.relu(beside - _POINT_SPACING_M).square())
        magnitude = torch.where(known, plane, magnitude)
    signed = torch.where(nearest.found, torch.where(inside, -magnitude, magnitude), far)
    return SurfaceDistances(signed, height, nearest.index)


def surface_distance(
    vertices: Tensor, scene: NearestPointSearch, settings: ContactSettings, free: Tensor | None = None
) -> Tensor:
    """Return the signed distance (..., V) of vertices (..., V, 3) to the scene; see :func:`surface_distances`."""
    return surface_distances(vertices, scene, None, settings, free).scene
