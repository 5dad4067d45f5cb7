"""Nearest scene point of each vertex, and distances to the scene and to the floor. Camera frame, metres."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.distances import signed_distance
from physic_core.engine.joint.context import JointContext
from physic_core.geometry.free_space import in_free_space
from physic_core.geometry.neighbors import NearestPointSearch, inside_body_boxes
from physic_core.geometry.plane import height_over_plane

MAX_MOTION_M = 0.6
"""Motion of people, metres, after which the search structure of nearby scene points is rebuilt."""


@dataclass(frozen=True)
class ContactState:
    """Nearest scene points and distances of the subsampled vertices (B, n).

    Attributes:
        found: bool, a scene point is within the search radius of the vertex.
        distance: to that point, metres.
        signed: along its normal, metres, negative inside; inf if no point is found.
        height: above the floor's plane, metres; inf if there is no plane.
        facing_scene: cosine between the body's normal and minus the scene's normal; 0 without a scene.
        facing_floor: cosine between the body's normal and minus the floor's normal.
        in_free_space: bool, nearer to the camera than the depth map at its pixel.
        points: (B, n, 3) nearest scene points, unscaled; None without a scene, as are the fields below.
        normals: (B, n, 3) of those points.
        plane_distance: of the planes through those points from the camera, ``n . p``, unscaled.
    """

    found: Tensor
    distance: Tensor
    signed: Tensor
    height: Tensor
    facing_scene: Tensor
    facing_floor: Tensor
    in_free_space: Tensor
    points: Tensor | None
    normals: Tensor | None
    plane_distance: Tensor | None


def nearby_scene(context: JointContext, vertices: Tensor, scale: float) -> NearestPointSearch:
    """Build the search structure of the scene points near people (B, V, 3), with a margin for their motion."""
    points, normals, radius = context.problem.scene_points, context.problem.scene_normals, context.search_radius_m
    keep = inside_body_boxes(points, vertices / scale, (radius + MAX_MOTION_M) / scale)
    return NearestPointSearch(points[keep], normals[keep], radius)


@torch.no_grad()
def update_contacts(
    context: JointContext, body_normals: Tensor, scene: NearestPointSearch, vertices: Tensor, scale: float
) -> ContactState:
    """Find the nearest scene points and measure the distances to them and to the floor.

    Args:
        body_normals: (B, n, 3) unit.
        scene: from :func:`nearby_scene`.
        vertices: (B, n, 3) subsampled vertices, metres.
        scale: of the scene.
    """
    problem, plane = context.problem, context.problem.floor_normal
    nearest = scene.query(vertices, scale)
    far, zeros = torch.full_like(context.area, torch.inf), torch.zeros_like(context.area)
    no = torch.zeros_like(context.on_visible_part)
    free = no if context.fronts is None else in_free_space(vertices / scale, context.fronts, problem.K)
    floor_offset = vertices.new_tensor(problem.floor_offset * scale)
    signed, facing_scene = far, zeros
    points = normals = plane_distance = None
    if len(scene.points):
        points, normals = scene.points[nearest.index], scene.normals[nearest.index]
        plane_distance = (normals * points).sum(-1)
        scaled = points * scale
        signed = torch.where(nearest.found, signed_distance(vertices, scaled, normals), far)
        facing_scene = -(body_normals * normals).sum(-1)
    return ContactState(
        found=nearest.found,
        distance=nearest.distance,
        signed=signed,
        height=far if plane is None else height_over_plane(vertices, plane, floor_offset),
        facing_scene=facing_scene,
        facing_floor=zeros if plane is None else -(body_normals @ plane),
        in_free_space=free,
        points=points,
        normals=normals,
        plane_distance=plane_distance,
    )
