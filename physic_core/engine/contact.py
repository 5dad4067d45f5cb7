"""Contact map: contact label and signed distance of each body vertex to scene and floor (paper sec. 3.3)."""

from __future__ import annotations

import torch
from torch import Tensor

from physic_core.engine.joint.distances import plane_height
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.settings import ContactSettings, EngineSettings
from physic_core.geometry.neighbors import NearestScene, near_boxes

__all__ = ["REACH_M", "contact_map", "contact_surface", "surface_distance"]

REACH_M = 0.15
"""Search radius, metres: larger distances are reported as inf. The contact thresholds of all presets are smaller."""

_SPREAD_M = 0.02  # metres, spacing of scene points: a vertex between four of them is on the surface, not 1 cm from it


def contact_map(
    vertices: Tensor,
    scene: NearestScene,
    floor: tuple[Tensor, float] | None,
    outer: Tensor,
    settings: ContactSettings,
    free: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """Contact and signed distance of every vertex.

    Args:
        vertices: (..., V, 3) metres, camera frame.
        scene: the scene's points and normals, already scaled; its radius is the farthest distance it reports.
        floor: unit normal (3,) and offset in metres, or None where there is no floor.
        outer: (V,) or (..., V) bool, vertices that may be in contact: False inside mouth and eyes.
        settings: of the contact map.
        free: (..., V) bool, as in :func:`surface_distance`.

    Returns:
        contact: (..., V) bool.
        distance: (..., V) metres, negative inside; inf where neither scene nor floor is within reach.
    """
    distance = surface_distance(vertices, scene, settings, free)
    if floor is not None:
        normal, offset = floor
        normal = normal.to(vertices)
        height = plane_height(vertices, normal, vertices.new_tensor(offset))
        height = torch.where(height.abs() < REACH_M, height, torch.full_like(height, torch.inf))
        distance = torch.where(height.abs() < distance.abs(), height, distance)
    contact = (distance <= settings.distance_m) & (distance >= -settings.inside_m) & outer
    return contact, distance


def contact_surface(
    problem: JointProblem, vertices: Tensor, scale: float, settings: EngineSettings
) -> tuple[NearestScene, tuple[Tensor, float] | None]:
    """Surfaces for contact, as in stage 3: the scaled scene near the bodies, and the floor's plane.

    If stage 3 uses samples of the floor, they are among the scene's points, and the plane is None.

    Args:
        problem: of stage 3.
        vertices: (B, V, 3) metres.
        scale: of the scene.
        settings: of the engine.
    """
    points, normals = problem.scene_points * scale, problem.scene_normals
    plane = None if problem.floor_normal is None else (problem.floor_normal, problem.floor_offset * scale)
    if plane is not None and problem.floor_points is not None and settings.joint.conventions.floor == "points":
        points = torch.cat([points, problem.floor_points * scale])
        normals = torch.cat([normals, plane[0].expand_as(problem.floor_points)])
        plane = None
    near = near_boxes(points, vertices, REACH_M)
    return NearestScene(points[near], normals[near], REACH_M), plane


def surface_distance(
    vertices: Tensor, scene: NearestScene, settings: ContactSettings, free: Tensor | None = None
) -> Tensor:
    """Signed distance (..., V) of each vertex to the surface sampled by the scene points, metres.

    "plane" measures along the normal of the nearest point, so that gaps between points do not count as distance; beyond
    the rim of a surface, the distance to the rim is added. The distance is positive at points without a normal, and for
    vertices in free space, ``free`` (..., V) bool, see :mod:`physic_core.geometry.free_space`. Beyond the search radius
    it is inf.
    """
    nearest = scene.query(vertices, radius=REACH_M)
    far = torch.full_like(nearest.distance, torch.inf)
    if not len(scene.points):
        return far
    normals = scene.normals[nearest.index].to(vertices)
    way = vertices - scene.points[nearest.index]
    along = (normals * way).sum(-1)
    inside = along < 0 if free is None else (along < 0) & ~free
    magnitude = nearest.distance
    if settings.metric == "plane":
        beside = (way - along[..., None] * normals).norm(dim=-1)
        known = normals.square().sum(-1) > 0.5
        plane = torch.sqrt(along.square() + torch.relu(beside - _SPREAD_M).square())
        magnitude = torch.where(known, plane, magnitude)
    return torch.where(nearest.found, torch.where(inside, -magnitude, magnitude), far)
