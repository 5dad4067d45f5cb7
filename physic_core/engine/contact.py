"""Contact map: contact label and signed distance to scene and floor of each body vertex (paper sec. 3.3)."""

from __future__ import annotations

import torch
from torch import Tensor

from physic_core.engine.joint.distances import plane_height
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.settings import ContactSettings, EngineSettings
from physic_core.geometry.neighbors import NearestPointSearch, inside_body_boxes

__all__ = ["SEARCH_RADIUS_M", "contact_map", "contact_surfaces", "surface_distance"]

SEARCH_RADIUS_M = 0.15
"""Search radius, metres: larger distances are reported as inf. The contact thresholds of all presets are smaller."""

_POINT_SPACING_M = 0.02  # of scene points: a vertex between four of them is on the surface, not 1 cm from it


def contact_map(
    vertices: Tensor,
    scene: NearestPointSearch,
    floor: tuple[Tensor, float] | None,
    outer: Tensor,
    settings: ContactSettings,
    free: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """Compute contact and signed distance of each vertex.

    Args:
        vertices: (..., V, 3) metres, camera frame.
        scene: scaled points and normals of the scene; its radius limits the distances.
        floor: unit normal (3,) and offset in metres; None if there is no floor.
        outer: (V,) or (..., V) bool, vertices that may be in contact: False inside mouth and eyes.
        free: (..., V) bool, as in :func:`surface_distance`.

    Returns:
        contact: (..., V) bool.
        distance: (..., V) metres, negative inside; inf if scene and floor are beyond the search radius.
    """
    distance = surface_distance(vertices, scene, settings, free)
    if floor is not None:
        normal, offset = floor
        normal = normal.to(vertices)
        height = plane_height(vertices, normal, vertices.new_tensor(offset))
        height = torch.where(height.abs() < SEARCH_RADIUS_M, height, torch.full_like(height, torch.inf))
        distance = torch.where(height.abs() < distance.abs(), height, distance)
    contact = (distance <= settings.distance_m) & (distance >= -settings.inside_m) & outer
    return contact, distance


def contact_surfaces(
    problem: JointProblem, vertices: Tensor, scale: float, settings: EngineSettings
) -> tuple[NearestPointSearch, tuple[Tensor, float] | None]:
    """Return the surfaces for contact: the scaled scene near bodies (B, V, 3), and the floor's plane.

    If stage 3 uses samples of the floor, they are among the scene's points, and the plane is None.
    """
    points, normals = problem.scene_points * scale, problem.scene_normals
    plane = None if problem.floor_normal is None else (problem.floor_normal, problem.floor_offset * scale)
    if plane is not None and problem.floor_points is not None and settings.joint.energy_options.floor == "points":
        points = torch.cat([points, problem.floor_points * scale])
        normals = torch.cat([normals, plane[0].expand_as(problem.floor_points)])
        plane = None
    near = inside_body_boxes(points, vertices, SEARCH_RADIUS_M)
    return NearestPointSearch(points[near], normals[near], SEARCH_RADIUS_M), plane


def surface_distance(
    vertices: Tensor, scene: NearestPointSearch, settings: ContactSettings, free: Tensor | None = None
) -> Tensor:
    """Return the signed distance (..., V) of each vertex to the scene's surface, metres.

    The metric "plane" measures along the normal of the nearest point, and adds the lateral distance beyond the rim of a
    surface. The distance is positive at points without a normal, and for vertices in free space, ``free`` (..., V)
    bool, see :mod:`physic_core.geometry.free_space`. It is inf beyond the search radius.
    """
    nearest = scene.query(vertices, radius=SEARCH_RADIUS_M)
    far = torch.full_like(nearest.distance, torch.inf)
    if not len(scene.points):
        return far
    normals = scene.normals[nearest.index].to(vertices)
    offset = vertices - scene.points[nearest.index]
    along = (normals * offset).sum(-1)
    inside = along < 0 if free is None else (along < 0) & ~free
    magnitude = nearest.distance
    if settings.metric == "plane":
        beside = (offset - along[..., None] * normals).norm(dim=-1)
        known = normals.square().sum(-1) > 0.5
        plane = torch.sqrt(along.square() + torch.relu(beside - _POINT_SPACING_M).square())
        magnitude = torch.where(known, plane, magnitude)
    return torch.where(nearest.found, torch.where(inside, -magnitude, magnitude), far)
