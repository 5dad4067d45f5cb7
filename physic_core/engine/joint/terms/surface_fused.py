"""The energies of the surface with their derivatives written out, in one node of the graph.

The arrays are small: autograd's overhead for a hundred operations exceeds their cost, a quarter of stage 3.
Arrays are (B, 3, n), since reductions over a last axis of three are slow.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from physic_core.engine.joint.distances import lowest_rows
from physic_core.engine.joint.terms.depth import LEAST_DEPTH_M
from physic_core.engine.joint.terms.surface import SURFACE_ENERGIES, Surface

__all__ = ["fused_surface_energies"]


def fused_surface_energies(
    surface: Surface, vertices: Tensor, pelvis: Tensor, root: Tensor, log_scale: Tensor, offset: Tensor, warp: Tensor
) -> tuple[Tensor, Tensor]:
    """As :func:`physic_core.engine.joint.terms.surface.reference_surface_energies`, differentiable once."""
    energies, lowest = _Fused.apply(  # type: ignore[no-untyped-call]
        surface, vertices, pelvis, root, log_scale, offset, warp
    )
    return energies, lowest


class _Fused(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        surface: Surface,
        vertices: Tensor,
        pelvis: Tensor,
        root: Tensor,
        log_scale: Tensor,
        offset: Tensor,
        warp: Tensor,
    ) -> tuple[Tensor, Tensor]:
        points = vertices.transpose(1, 2).contiguous()
        none = torch.zeros_like(offset)
        energies = dict.fromkeys(SURFACE_ENERGIES, none)
        slopes: dict[str, Tensor] = {}
        unit = 1.0 / log_scale.exp()

        ahead = base = signed = over = height = torch.zeros_like(surface.plane_distance)
        if surface.normals is not None:
            ahead = unit * (surface.normals * points).sum(1)
            base = surface.plane_distance
            if surface.warp_share is not None:
                base = base * torch.exp(warp[:, None] * surface.warp_share)
            signed = ahead - base
        if surface.floor_normal is not None:
            over = unit * (surface.floor_normal @ points)
            height = over + surface.floor_offset

        if surface.depth is not None:
            away = points[:, 2].clamp(min=LEAST_DEPTH_M).log()
            residual = away - surface.log_seen - (log_scale + offset)[:, None]
            energies["depth"], slopes["depth"] = surface.depth.with_slope(residual)
        if surface.contact is not None:
            touched = torch.where(surface.on_scene, signed, height)
            energies["contact"], slopes["contact"] = surface.contact.with_slope(touched)
        if surface.penetration is not None:
            inside = torch.relu(-signed - surface.penetration_slack)
            energies["penetration"], slopes["penetration"] = surface.penetration.with_slope(inside)
        if surface.floor is not None:
            last = over + unit * (surface.floor_offset * surface.last_scale)
            under = torch.relu(-torch.where(surface.in_play, height, last))
            energies["floor"], slopes["floor"] = surface.floor.with_slope(under)
        # In the camera frame: a rotation does not change the length.
        deviation = (points - pelvis[..., None]) - root @ surface.relative
        slopes["mesh"] = 2.0 * surface.mesh_weight[:, None] * deviation
        energies["mesh"] = 0.5 * (slopes["mesh"] * deviation).sum((1, 2))
        feet = [sole[lowest_rows(height[:, sole])] if len(sole) else None for sole in surface.soles]
        lowest = [none if foot is None else height.gather(1, foot).mean(1) for foot in feet]

        ctx.surface, ctx.slopes, ctx.feet = surface, slopes, feet
        ctx.save_for_backward(points, ahead, base, over, unit)
        return torch.stack([energies[name] for name in SURFACE_ENERGIES]), torch.stack(lowest, 1)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        surface: Surface = ctx.surface
        points, ahead, base, over, unit = ctx.saved_tensors
        of_terms = dict(zip(SURFACE_ENERGIES, gradients[0][..., None], strict=True))
        of_feet = gradients[1].unbind(1)
        slopes: dict[str, Tensor] = ctx.slopes
        by_scale = torch.zeros_like(unit)
        by_offset = by_warp = None

        # By the distances to the scene and to the floor, and to the floor as the last view's scale has it.
        by_signed = by_height = by_last = torch.zeros_like(ahead)
        if "contact" in slopes:
            by_touched = of_terms["contact"] * slopes["contact"]
            by_signed = torch.where(surface.on_scene, by_touched, by_signed)
            by_height = by_touched - by_signed
        if "penetration" in slopes:
            by_signed = by_signed - of_terms["penetration"] * slopes["penetration"]
        if "floor" in slopes:
            by_under = of_terms["floor"] * slopes["floor"]
            by_ruler = torch.where(surface.in_play, by_under, by_last)
            by_height, by_last = by_height - by_ruler, by_ruler - by_under
        for foot, of_foot in zip(ctx.feet, of_feet, strict=True):
            if foot is not None:
                by_height = by_height.scatter_add(1, foot, (of_foot / foot.shape[1])[:, None].expand_as(foot))

        by_point = torch.zeros_like(points)
        if surface.normals is not None:
            by_point = (unit * by_signed)[:, None] * surface.normals
            by_scale = by_scale - (by_signed * ahead).sum()
            if surface.warp_share is not None:
                by_warp = -(by_signed * base * surface.warp_share).sum(1)
        if surface.floor_normal is not None:
            by_point = by_point + (unit * (by_height + by_last))[:, None] * surface.floor_normal[:, None]
            by_scale = by_scale - (by_height * over).sum()
        by_deviation = of_terms["mesh"][..., None] * slopes["mesh"]
        by_point = by_point + by_deviation
        by_pelvis, by_root = -by_deviation.sum(2), -by_deviation @ surface.relative.transpose(1, 2)
        if "depth" in slopes:
            by_log = of_terms["depth"] * slopes["depth"]
            away = points[:, 2]
            by_point[:, 2] += torch.where(away > LEAST_DEPTH_M, by_log / away, torch.zeros_like(away))
            by_offset = -by_log.sum(1)
            by_scale = by_scale + by_offset.sum()
        return None, by_point.transpose(1, 2), by_pelvis, by_root, by_scale, by_offset, by_warp
