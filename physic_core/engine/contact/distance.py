"""Signed distances of body vertices to scene and floor. Camera frame, metres."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import torch
from torch import Tensor

from physic_core.engine.joint.problem import JointProblem
from physic_core.geometry.neighbors import NearestPointSearch, inside_body_boxes
from physic_core.geometry.plane import height_over_plane

SEARCH_RADIUS_M = 0.15
"""Search radius, metres: larger distances are reported as inf.

The contact thresholds of all presets are smaller.
"""

# of scene points: a vertex between four of them is on the surface, not 1 cm from it
_POINT_SPACING_M = 0.02

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
        row: (n,) int64, row of each of these points in ``JointProblem.scene_points``; -1 for
            samples of the floor.
        floor: unit normal (3,) and offset in metres; None without a plane, or if its samples are in
            ``scene``.
    """

    scene: NearestPointSearch
    row: Tensor
    floor: tuple[Tensor, float] | None


@dataclass(frozen=True)
class SurfaceDistances:
    """Signed distances of vertices to scene and floor, metres: negative inside, inf beyond the
    search radius.

    Attributes:
        scene: (..., V).
        floor: (..., V); inf without a plane.
        point: (..., V) int64, nearest point of ``ContactSurfaces.scene``; 0 if none is within the
            search radius.
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
        """Vertices (..., V) bool that are nearer to the floor's plane than to the scene."""
        return self.floor.abs() < self.scene.abs()


def nearby_surfaces(
    problem: JointProblem, vertices: Tensor, scale: float, floor: tuple[Tensor, float] | None
) -> ContactSurfaces:
    """Return the scaled scene near bodies (B, V, 3), metres, and a floor."""
    points = problem.scene_points * scale
    normals = problem.scene_normals
    near = inside_body_boxes(points, vertices, SEARCH_RADIUS_M)
    scene = NearestPointSearch(points[near], normals[near], SEARCH_RADIUS_M)
    return ContactSurfaces(scene, near.nonzero(as_tuple=True)[0], floor)


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
        normal, offset = surfaces.floor
        height = height_over_plane(vertices, normal.to(vertices), vertices.new_tensor(offset))
        height = torch.where(height.abs() < SEARCH_RADIUS_M, height, far)
    if not len(scene.points):
        return SurfaceDistances(far, height, nearest.index)
    normals = scene.normals[nearest.index].to(vertices)
    offsets = vertices - scene.points[nearest.index]
    along = (normals * offsets).sum(-1)
    inside = along < 0 if free is None else (along < 0) & ~free
    magnitude = measure(offsets, normals, nearest.distance)
    signed = torch.where(nearest.found, torch.where(inside, -magnitude, magnitude), far)
    return SurfaceDistances(signed, height, nearest.index)


def distance_along_normal(offsets: Tensor, normals: Tensor, distance: Tensor) -> Tensor:
    """Measure along the normal of the nearest point, and add the lateral distance beyond the rim of
    a surface.
    """
    along = (normals * offsets).sum(-1)
    beside = (offsets - along[..., None] * normals).norm(dim=-1)
    plane = torch.sqrt(along.square() + torch.relu(beside - _POINT_SPACING_M).square())
    return torch.where(normals.square().sum(-1) > 0.5, plane, distance)
