"""What the photo shows of each vertex, looked at anew whenever the people have moved a while: masks and rays."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from physic_core.body.model import BodyOutput
from physic_core.engine.joint.context import Fixed
from physic_core.engine.joint.limbs import limb_parts
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.settings import JointSettings
from physic_core.geometry.camera import project
from physic_core.geometry.visibility import (
    facing,
    inside_image,
    self_occlusion,
    vertex_normals,
)

__all__ = ["Shadows", "Visible", "around", "look", "occluded"]

_STILL_M = 0.01  # who has moved less than this in the mean, across their rays, looks as they did
_EDGE_SHARE = 0.005  # of the person: nearer to the silhouette, depth is as often the background's


@dataclass(frozen=True)
class Visible:
    """See the module. n are the tracked vertices.

    Attributes:
        normals: (B, n, 3) of the body.
        in_play: (B, n) bool, inside the image and on a limb that the photo shows: may touch and penetrate.
        in_mask: (B, n) bool, on the own mask: not hidden by an object or another person.
        hidden: (B, n) bool, hidden by objects, other people or the own body.
        facing: (B, n) bool, camera-facing and on the own mask.
        depth_weight: (B, n), 0 but for vertices that the depth map shows.
        log_seen: (B, n) logarithm of the depth map at their pixels, finite.
    """

    normals: Tensor
    in_play: Tensor
    in_mask: Tensor
    hidden: Tensor
    facing: Tensor
    depth_weight: Tensor
    log_seen: Tensor


class Shadows:
    """Self-occlusion of people who move, cast anew for those who have moved.

    Args:
        problem: with finite people only.
        settings: of stage 3.
    """

    def __init__(self, problem: JointProblem, settings: JointSettings) -> None:
        model = problem.model
        self._cast = partial(
            self_occlusion,
            faces=model.faces,
            part_of_vertex=model.part_of_vertex,
            parts=limb_parts(model.part_names),
            share=settings.self_occlusion_share,
            coarse=model.coarse if settings.self_occlusion_mesh == "coarse" else None,
        )
        self._seen: Tensor | None = None
        self._hidden = self._lost = torch.zeros(0)

    def __call__(self, vertices: Tensor) -> tuple[Tensor, Tensor]:
        """(B, V) bool each: vertices behind any face of their own body, and vertices of limbs that count as hidden."""
        away = vertices[..., 2].mean(1).abs().clamp(min=1e-6)[:, None, None]
        # Nearer and farther along the same rays, a body looks the same.
        seen = vertices / away
        if self._seen is None:
            shadow = self._cast(vertices)
            self._seen, self._hidden, self._lost = seen, shadow.hidden, shadow.vertices
        else:
            moved = ((seen - self._seen) * away).square().sum(-1).mean(1).sqrt()
            rows = (~(moved < _STILL_M)).nonzero(as_tuple=True)[0]
            if len(rows):
                shadow = self._cast(vertices[rows])
                self._seen = self._seen.index_copy(0, rows, seen[rows])
                self._hidden = self._hidden.index_copy(0, rows, shadow.hidden)
                self._lost = self._lost.index_copy(0, rows, shadow.vertices)
        return self._hidden, self._lost


@torch.no_grad()
def look(problem: JointProblem, settings: JointSettings, fixed: Fixed, output: BodyOutput, shadows: Shadows) -> Visible:
    """Project the tracked vertices and cast a ray at each.

    Args:
        problem: with finite people only.
        settings: of stage 3.
        fixed: what stays as it is.
        output: the posed bodies now, all vertices.
        shadows: of these people.
    """
    model, ids, vertices = problem.model, fixed.ids, output.vertices[:, fixed.ids]
    masks = _masks(problem, settings)
    uv = project(vertices, problem.K)
    in_image = _in_image(uv, vertices, masks)
    in_mask = in_image & around(uv, masks, fixed.person_px * settings.mask_tolerance).any(0)
    behind_self, lost = (flags[:, ids] for flags in shadows(output.vertices))

    normals = vertex_normals(output.vertices, model.faces, fixed.faces_around)
    toward = facing(normals, vertices, settings.facing_deg)
    in_play = fixed.seen_part & in_image
    log_seen, known = _sample(fixed.log_depth, uv)
    well_inside = around(uv, masks, fixed.person_px * _EDGE_SHARE).all(0)
    shown = toward & ~behind_self
    # Seen at a slant, a surface fills fewer pixels: weigh by what it fills.
    slope = -(normals * torch.nn.functional.normalize(vertices, dim=-1)).sum(-1)
    weight = torch.where(shown & known & well_inside & in_play, fixed.area * slope, torch.zeros_like(fixed.area))
    return Visible(
        normals=normals,
        in_play=in_play,
        in_mask=in_mask,
        hidden=~in_mask | lost,
        facing=toward & in_mask,
        depth_weight=weight,
        log_seen=log_seen,
    )


@torch.no_grad()
def occluded(
    problem: JointProblem, settings: JointSettings, fixed: Fixed, vertices: Tensor, shadows: Shadows
) -> Tensor:
    """Which of all vertices (B, V, 3) objects, other people or the own body hide, as in :attr:`Visible.hidden`."""
    masks = _masks(problem, settings)
    uv = project(vertices, problem.K)
    near = around(uv, masks, fixed.person_px * settings.mask_tolerance).any(0)
    return ~(near & _in_image(uv, vertices, masks)) | shadows(vertices)[1]


def _masks(problem: JointProblem, settings: JointSettings) -> Tensor:
    masks = problem.masks
    return masks.any(0, keepdim=True).expand_as(masks) if settings.visibility == "released" else masks


def _in_image(uv: Tensor, vertices: Tensor, masks: Tensor) -> Tensor:
    # Behind the camera nothing is seen, whatever the clamped division says.
    return inside_image(uv, *masks.shape[-2:]) & (vertices[..., 2] > 0)


def around(uv: Tensor, masks: Tensor, reach: Tensor) -> Tensor:
    """Whether the pixels at and round each coordinate are on the mask: (B, V, 2), (B, H, W), (B,) px -> (9, B, V)."""
    height, width = masks.shape[-2:]
    steps = torch.tensor([-1.0, 0.0, 1.0], device=uv.device, dtype=uv.dtype) * reach[:, None]
    u, v = ((uv[..., None, :, axis] + steps[..., None]) for axis in (0, 1))  # (B, 3, V): three columns and three rows
    in_u, in_v = (u >= -0.5) & (u < width - 0.5), (v >= -0.5) & (v < height - 0.5)
    column, row = (torch.where(inside, x, 0.0).round().long() for inside, x in ((in_u, u), (in_v, v)))
    pixel = (row[:, :, None] * width + column[:, None]).flatten(1)
    inside = (in_v[:, :, None] & in_u[:, None]).flatten(1)
    found = masks.flatten(1).gather(1, pixel) & inside
    return found.reshape(len(uv), 9, -1).transpose(0, 1)


def _sample(log_depth: Tensor | None, uv: Tensor) -> tuple[Tensor, Tensor]:
    """The map at the nearest pixel, 0 where unknown, and where it is known: (B, n) each."""
    if log_depth is None:
        return torch.zeros_like(uv[..., 0]), torch.zeros_like(uv[..., 0], dtype=torch.bool)
    height, width = log_depth.shape
    inside = inside_image(uv, height, width)
    at = torch.where(inside[..., None], uv, torch.zeros_like(uv)).round().long()
    value = log_depth[at[..., 1], at[..., 0]].to(uv.dtype)
    known = inside & torch.isfinite(value)
    return torch.where(known, value, torch.zeros_like(value)), known
