"""Visibility and contacts of vertices at a refresh.

A vertex is visible inside the person's mask, if it is not self-occluded and faces the camera.
OpenCV camera frame, metres and pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from physic_core.body.model import BodyOutput
from physic_core.engine.joint.sampling import Sampling
from physic_core.engine.limbs import limb_part_indices
from physic_core.geometry.camera import project
from physic_core.geometry.mesh import vertex_normals
from physic_core.geometry.neighbors import NearestPointSearch
from physic_core.geometry.visibility import (
    facing_camera,
    in_free_space,
    inside_image,
    self_occlusion,
)

HIDDEN_LIMB_SHARE = 0.3
"""A limb segment is hidden if this share of its vertices lies behind other parts; as in the
released code.
"""

_MIN_MOTION_M = 0.01  # mean motion across the rays from which self-occlusion is computed again

MAX_MOTION_M = 0.6
"""Motion of people, metres, after which the search structure of nearby scene points is rebuilt."""


@dataclass(frozen=True)
class Visibility:
    """Visibility of the subsampled vertices (B, n) of B people.

    Attributes:
        uv: (B, n, 2) px, projected vertices.
        normals: (B, n, 3) of the body, unit.
        eligible: (B, n) bool, inside the image and on a visible limb: eligible for contact and
            penetration.
        in_mask: (B, n) bool, inside the person's mask: not hidden by an object or another person.
        hidden: (B, n) bool, hidden by objects, other people or the person's own body.
        facing: (B, n) bool, camera-facing and inside the person's mask.
        unobstructed: (B, n) bool, camera-facing and not self-occluded.
    """

    uv: Tensor
    normals: Tensor
    eligible: Tensor
    in_mask: Tensor
    hidden: Tensor
    facing: Tensor
    unobstructed: Tensor


class OcclusionTracker:
    """Self-occlusion of moving people; rays are recast only for people who have moved."""

    def __init__(self, sampling: Sampling) -> None:
        model = sampling.state.model
        self._cast = partial(
            self_occlusion,
            faces=model.faces,
            part_of_vertex=model.part_of_vertex,
            parts=limb_part_indices(model.part_names),
            share=HIDDEN_LIMB_SHARE,
            coarse=model.coarse if sampling.visibility.vertex_spacing_m else None,
        )
        start = sampling.start.vertices
        self._seen = torch.full_like(start, torch.inf)
        self._hidden = self._hidden_limbs = torch.zeros_like(start[..., 0], dtype=torch.bool)

    def __call__(self, vertices: Tensor) -> tuple[Tensor, Tensor]:
        """Compute the self-occlusion of vertices (B, V, 3).

        Returns:
            hidden: (B, V) bool, behind any face of their own body.
            hidden_limbs: (B, V) bool, on a limb that counts as hidden.
        """
        away = vertices[..., 2].mean(1).abs().clamp(min=1e-6)[:, None, None]
        # Motion along the rays does not change the self-occlusion.
        rays = vertices / away
        moved = ((rays - self._seen) * away).square().sum(-1).mean(1).sqrt()
        rows = (~(moved < _MIN_MOTION_M)).nonzero(as_tuple=True)[0]
        if len(rows):
            hidden, hidden_limbs = self._cast(vertices[rows])
            self._seen = self._seen.index_copy(0, rows, rays[rows])
            self._hidden = self._hidden.index_copy(0, rows, hidden)
            self._hidden_limbs = self._hidden_limbs.index_copy(0, rows, hidden_limbs)
        return self._hidden, self._hidden_limbs


@torch.no_grad()
def update_visibility(
    sampling: Sampling, bodies: BodyOutput, self_occlusion: OcclusionTracker
) -> Visibility:
    """Compute the visibility of the subsampled vertices from masks, normals and ray casting.

    Args:
        bodies: posed at the current state, all vertices.
        self_occlusion: of the B people.
    """
    state = sampling.state
    settings = sampling.visibility
    vertices = bodies.vertices[:, sampling.ids]
    masks = state.masks
    uv = project(vertices, state.K)
    # Points behind the camera are not visible, although the clamped division gives them a pixel.
    in_image = inside_image(uv, *masks.shape[-2:]) & (vertices[..., 2] > 0)
    in_mask = in_image & sample_mask_neighbours(
        uv, masks, sampling.person_px * settings.mask_tolerance
    ).any(0)
    behind_self, hidden_limb = (flags[:, sampling.ids] for flags in self_occlusion(bodies.vertices))
    normals = vertex_normals(bodies.vertices, sampling.faces, sampling.faces_of_vertices)
    toward = facing_camera(normals, vertices, settings.facing_deg)
    return Visibility(
        uv=uv,
        normals=normals,
        eligible=sampling.on_visible_part & in_image,
        in_mask=in_mask,
        hidden=~in_mask | hidden_limb,
        facing=toward & in_mask,
        unobstructed=toward & ~behind_self,
    )


def sample_mask_neighbours(uv: Tensor, masks: Tensor, reach: Tensor) -> Tensor:
    """Sample masks (B, H, W) at pixels (B, V, 2) and at eight neighbours, ``reach`` (B,) px away:
    (9, B, V) bool.
    """
    height, width = masks.shape[-2:]
    steps = torch.tensor([-1.0, 0.0, 1.0], dtype=uv.dtype) * reach[:, None]
    # (B, 3, V): three columns and three rows
    u, v = ((uv[..., None, :, axis] + steps[..., None]) for axis in (0, 1))
    in_u = (u >= -0.5) & (u < width - 0.5)
    in_v = (v >= -0.5) & (v < height - 0.5)
    column, row = (
        torch.where(inside, x, 0.0).round().long() for inside, x in ((in_u, u), (in_v, v))
    )
    pixel = (row[:, :, None] * width + column[:, None]).flatten(1)
    inside = (in_v[:, :, None] & in_u[:, None]).flatten(1)
    values = masks.flatten(1).gather(1, pixel) & inside
    return values.reshape(len(uv), 9, -1).transpose(0, 1)


@dataclass(frozen=True)
class ContactState:
    """Nearest scene points and distances of the subsampled vertices (B, n).

    Attributes:
        is_found: bool, a scene point is within the search radius of the vertex.
        distance: to that point, metres.
        signed: to its plane, ``n . (v - p)``, metres, negative inside; inf if no point is found.
        height: above the floor's plane, metres; inf if there is no plane.
        facing_scene: cosine between the body's normal and minus the scene's normal; 0 without a
            scene.
        facing_floor: cosine between the body's normal and minus the floor's normal.
        in_free_space: bool, nearer to the camera than the depth map at its pixel.
        points: (B, n, 3) nearest scene points, unscaled; 0 without a scene, as are the fields
            below.
        normals: (B, n, 3) of those points.
        plane_distance: of the planes through those points from the camera, ``n . p``, unscaled.
    """

    is_found: Tensor
    distance: Tensor
    signed: Tensor
    height: Tensor
    facing_scene: Tensor
    facing_floor: Tensor
    in_free_space: Tensor
    points: Tensor
    normals: Tensor
    plane_distance: Tensor


@torch.no_grad()
def update_contacts(
    sampling: Sampling,
    body_normals: Tensor,
    scene: NearestPointSearch,
    vertices: Tensor,
    scale: float,
) -> ContactState:
    """Find the nearest scene points and measure the distances to them and to the floor.

    Args:
        body_normals: (B, n, 3) unit.
        scene: from ``JointStageMethod.nearby_scene``.
        vertices: (B, n, 3) subsampled vertices, metres.
        scale: of the scene.
    """
    state = sampling.state
    floor = sampling.surroundings.floor
    nearest = scene.query(vertices, scale)
    height = far = torch.full_like(sampling.area, torch.inf)
    facing_floor = torch.zeros_like(sampling.area)
    free = torch.zeros_like(sampling.on_visible_part)
    points = normals = torch.zeros_like(vertices)
    if sampling.fronts is not None:
        free = in_free_space(vertices / scale, sampling.fronts, state.K)
    if floor is not None:
        height = floor.scaled(scale).height(vertices)
        facing_floor = -(body_normals @ floor.normal)
    if len(scene.points):
        points = scene.points[nearest.index]
        normals = scene.normals[nearest.index]
    signed = (normals * (vertices - points * scale)).sum(-1)
    return ContactState(
        is_found=nearest.is_found,
        distance=nearest.distance,
        signed=torch.where(nearest.is_found, signed, far),
        height=height,
        facing_scene=-(body_normals * normals).sum(-1),
        facing_floor=facing_floor,
        in_free_space=free,
        points=points,
        normals=normals,
        plane_distance=(normals * points).sum(-1),
    )
