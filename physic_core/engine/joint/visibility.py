"""Visibility of each vertex: inside the person's mask, not self-occluded, and facing the camera.

The optimiser updates the visibility every few steps. OpenCV camera frame, metres and pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from physic_core.body.model import BodyOutput
from physic_core.engine.joint.context import JointContext
from physic_core.engine.limbs import limb_part_indices
from physic_core.geometry.camera import project
from physic_core.geometry.mesh import vertex_normals
from physic_core.geometry.visibility import facing_camera, inside_image, self_occlusion

HIDDEN_LIMB_SHARE = 0.3
"""A limb segment is hidden if this share of its vertices lies behind other parts; as in the released code."""

_MIN_MOTION_M = 0.01  # mean motion of a person across the rays, from which self-occlusion is computed again


@dataclass(frozen=True)
class Visibility:
    """Visibility of the subsampled vertices (B, n) of B people.

    Attributes:
        uv: (B, n, 2) px, projected vertices.
        normals: (B, n, 3) of the body, unit.
        eligible: (B, n) bool, inside the image and on a visible limb: eligible for contact and penetration.
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

    def __init__(self, context: JointContext) -> None:
        model = context.problem.model
        self._cast = partial(
            self_occlusion,
            faces=model.faces,
            part_of_vertex=model.part_of_vertex,
            parts=limb_part_indices(model.part_names),
            share=HIDDEN_LIMB_SHARE,
            coarse=model.coarse if context.visibility.vertex_spacing_m else None,
        )
        self._seen: Tensor | None = None
        self._hidden = self._hidden_limbs = torch.zeros(0)

    def __call__(self, vertices: Tensor) -> tuple[Tensor, Tensor]:
        """Compute the self-occlusion of vertices (B, V, 3).

        Returns:
            hidden: (B, V) bool, behind any face of their own body.
            hidden_limbs: (B, V) bool, on a limb that counts as hidden.
        """
        away = vertices[..., 2].mean(1).abs().clamp(min=1e-6)[:, None, None]
        # Motion along the rays does not change the self-occlusion.
        seen = vertices / away
        if self._seen is None:
            shadow = self._cast(vertices)
            self._seen, self._hidden, self._hidden_limbs = seen, shadow.hidden, shadow.vertices
        else:
            moved = ((seen - self._seen) * away).square().sum(-1).mean(1).sqrt()
            rows = (~(moved < _MIN_MOTION_M)).nonzero(as_tuple=True)[0]
            if len(rows):
                shadow = self._cast(vertices[rows])
                self._seen = self._seen.index_copy(0, rows, seen[rows])
                self._hidden = self._hidden.index_copy(0, rows, shadow.hidden)
                self._hidden_limbs = self._hidden_limbs.index_copy(0, rows, shadow.vertices)
        return self._hidden, self._hidden_limbs


@torch.no_grad()
def update_visibility(context: JointContext, bodies: BodyOutput, self_occlusion: OcclusionTracker) -> Visibility:
    """Compute the visibility of the subsampled vertices from masks, normals and ray casting.

    Args:
        bodies: posed at the current state, all vertices.
        self_occlusion: of the B people.
    """
    problem, settings = context.problem, context.visibility
    vertices = bodies.vertices[:, context.ids]
    masks = problem.masks
    uv = project(vertices, problem.K)
    in_image = _in_image(uv, vertices, masks)
    in_mask = in_image & sample_mask_neighbours(uv, masks, context.person_px * settings.mask_tolerance).any(0)
    behind_self, hidden_limb = (flags[:, context.ids] for flags in self_occlusion(bodies.vertices))
    normals = vertex_normals(bodies.vertices, context.faces, context.faces_of_vertices)
    toward = facing_camera(normals, vertices, settings.facing_deg)
    return Visibility(
        uv=uv,
        normals=normals,
        eligible=context.on_visible_part & in_image,
        in_mask=in_mask,
        hidden=~in_mask | hidden_limb,
        facing=toward & in_mask,
        unobstructed=toward & ~behind_self,
    )


def _in_image(uv: Tensor, vertices: Tensor, masks: Tensor) -> Tensor:
    """Return which vertices (B, V) project into the image."""
    # Points behind the camera are not visible, although the clamped division gives them a pixel.
    return inside_image(uv, *masks.shape[-2:]) & (vertices[..., 2] > 0)


def sample_mask_neighbours(uv: Tensor, masks: Tensor, reach: Tensor) -> Tensor:
    """Sample masks (B, H, W) at pixels (B, V, 2) and at eight neighbours, ``reach`` (B,) px away: (9, B, V) bool."""
    height, width = masks.shape[-2:]
    steps = torch.tensor([-1.0, 0.0, 1.0], device=uv.device, dtype=uv.dtype) * reach[:, None]
    u, v = ((uv[..., None, :, axis] + steps[..., None]) for axis in (0, 1))  # (B, 3, V): three columns and three rows
    in_u, in_v = (u >= -0.5) & (u < width - 0.5), (v >= -0.5) & (v < height - 0.5)
    column, row = (torch.where(inside, x, 0.0).round().long() for inside, x in ((in_u, u), (in_v, v)))
    pixel = (row[:, :, None] * width + column[:, None]).flatten(1)
    inside = (in_v[:, :, None] & in_u[:, None]).flatten(1)
    found = masks.flatten(1).gather(1, pixel) & inside
    return found.reshape(len(uv), 9, -1).transpose(0, 1)
