"""What vertices pay for where they are, with its derivative written out: depth, contact, penetration, floor and mesh.

Term by term as in :mod:`physic_core.engine.joint.terms`, whose functions the tests hold it to, but for distances along
normals alone and in one node of the graph: the arrays are short, and keeping books on each of a hundred operations
costs more than they do. Axes come before vertices here: products and sums over three neighbours are slow.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from physic_core.engine.joint.terms import LEAST_DEPTH_M, lowest_rows
from physic_core.geometry.robust import unit_robust

__all__ = ["SURFACE_TERMS", "RobustSum", "Surface", "surface_terms"]

SURFACE_TERMS = ("depth", "contact", "penetration", "floor", "mesh")


@dataclass(frozen=True)
class RobustSum:
    """``sum_v w_v rho(r_v^2 / sigma^2)`` of residuals (B, n); made by :meth:`of`.

    Attributes:
        kind: of loss, see :mod:`physic_core.geometry.robust`.
        scale: of it.
        unit: what turns residuals into shares of where the loss bends.
        of_value: (B, n) weights of the values.
        of_slope: (B, n) weights of the derivatives.
    """

    kind: str
    scale: float
    unit: float
    of_value: Tensor
    of_slope: Tensor

    @classmethod
    def of(cls, kind: str, scale: float, sigma: float, weight: Tensor) -> RobustSum:
        """With weights (B, n) and an expected residual ``sigma``."""
        return cls(kind, scale, 1.0 / (sigma * scale), weight * scale**2, weight * (2.0 / sigma**2))

    def __call__(self, residual: Tensor) -> tuple[Tensor, Tensor]:
        """A value of each person (B,), and its derivative by the residuals (B, n)."""
        loss, slope = unit_robust(self.kind, (residual * self.unit).square(), self.scale)
        return (self.of_value * loss).sum(1), self.of_slope * residual * slope


@dataclass(frozen=True)
class Surface:
    """What does not change between two looks. B people, n tracked vertices.

    Attributes:
        depth: of the difference of logarithms of depth; this and those below are None where a term is not there.
        contact: of the distance to what is touched.
        penetration: of the depth inside the scene, as far as it is over the slack.
        floor: the same of the depth under the floor.
        mesh_weight: (B, n), of the squared way from where a vertex was at the start, in the root's frame.
        log_seen: (B, n) logarithm of the depth map at the vertices.
        on_scene: (B, n) bool, contact is with the scene; else with the floor.
        penetration_slack: metres.
        ruler: (B, n) bool, of whom the floor may learn its scale; for the others that of the last look stands.
        relative: (B, 3, n) at the start in the root's frame, metres.
        normals: (B, 3, n) of the nearest scene points, None without a scene.
        along: (B, n) distance of their planes from the camera, unscaled.
        warp_share: (B, n) how much of their person's warp they take, None where warps are frozen.
        plane: (3,) unit normal of the floor, None without one.
        offset: of the floor.
        last_scale: of the scene, at the last look.
        in_scene_units: distances are divided by the scene's scale.
        soles: rows of the left and the right sole's vertices.
    """

    depth: RobustSum | None
    contact: RobustSum | None
    penetration: RobustSum | None
    floor: RobustSum | None
    mesh_weight: Tensor | None
    log_seen: Tensor
    on_scene: Tensor
    penetration_slack: float
    ruler: Tensor
    relative: Tensor
    normals: Tensor | None
    along: Tensor
    warp_share: Tensor | None
    plane: Tensor | None
    offset: float
    last_scale: float
    in_scene_units: bool
    soles: tuple[Tensor, Tensor]


def surface_terms(
    surface: Surface, vertices: Tensor, pelvis: Tensor, root: Tensor, log_scale: Tensor, offset: Tensor, warp: Tensor
) -> tuple[Tensor, Tensor]:
    """The terms at these places, once differentiable by all of them.

    Args:
        surface: since the last look.
        vertices: (B, n, 3) metres.
        pelvis: (B, 3) metres.
        root: (B, 3, 3).
        log_scale: () of the scene.
        offset: (B,) of each person's depth.
        warp: (B,) of what is round them.

    Returns:
        energies: (5, B) of :data:`SURFACE_TERMS`, 0 where a term is not there.
        lowest: (B, 2) height of the left and the right sole, in the unit of distances; 0 where there is none.
    """
    energies, lowest = _Terms.apply(  # type: ignore[no-untyped-call]
        surface, vertices, pelvis, root, log_scale, offset, warp
    )
    return energies, lowest


class _Terms(torch.autograd.Function):
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
        energies = dict.fromkeys(SURFACE_TERMS, none)
        slopes: dict[str, Tensor] = {}
        scale, one = log_scale.exp(), torch.ones_like(log_scale)
        unit, reach = (1.0 / scale, one) if surface.in_scene_units else (one, scale)

        ahead = base = signed = over = height = torch.zeros_like(surface.along)
        if surface.normals is not None:
            ahead = unit * (surface.normals * points).sum(1)
            base = reach * surface.along
            if surface.warp_share is not None:
                base = base * torch.exp(warp[:, None] * surface.warp_share)
            signed = ahead - base
        if surface.plane is not None:
            over = unit * (surface.plane @ points)
            height = over + reach * surface.offset

        if surface.depth is not None:
            away = points[:, 2].clamp(min=LEAST_DEPTH_M).log()
            energies["depth"], slopes["depth"] = surface.depth(away - surface.log_seen - (log_scale + offset)[:, None])
        if surface.contact is not None:
            touched = torch.where(surface.on_scene, signed, height)
            energies["contact"], slopes["contact"] = surface.contact(touched)
        if surface.penetration is not None:
            inside = torch.relu(-signed - surface.penetration_slack)
            energies["penetration"], slopes["penetration"] = surface.penetration(inside)
        if surface.floor is not None:
            last = over + unit * (surface.offset * surface.last_scale)
            under = torch.relu(-torch.where(surface.ruler, height, last))
            energies["floor"], slopes["floor"] = surface.floor(under)
        if surface.mesh_weight is not None:
            # In the camera's frame, in which it is as long as in the root's.
            strayed = (points - pelvis[..., None]) - root @ surface.relative
            slopes["mesh"] = 2.0 * surface.mesh_weight[:, None] * strayed
            energies["mesh"] = 0.5 * (slopes["mesh"] * strayed).sum((1, 2))
        feet = [sole[lowest_rows(height[:, sole])] if len(sole) else None for sole in surface.soles]
        lowest = [none if foot is None else height.gather(1, foot).mean(1) for foot in feet]

        ctx.surface, ctx.slopes, ctx.feet = surface, slopes, feet
        ctx.save_for_backward(points, ahead, base, over, unit, reach)
        return torch.stack([energies[name] for name in SURFACE_TERMS]), torch.stack(lowest, 1)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        surface: Surface = ctx.surface
        points, ahead, base, over, unit, reach = ctx.saved_tensors
        of_terms = dict(zip(SURFACE_TERMS, gradients[0][..., None], strict=True))
        of_feet = gradients[1].unbind(1)
        slopes: dict[str, Tensor] = ctx.slopes
        by_scale = torch.zeros_like(unit)
        by_offset = by_warp = by_pelvis = by_root = None

        # By the distances to the scene and to the floor, and to the floor as the last look's scale has it.
        by_signed = by_height = by_last = torch.zeros_like(ahead)
        if "contact" in slopes:
            by_touched = of_terms["contact"] * slopes["contact"]
            by_signed = torch.where(surface.on_scene, by_touched, by_signed)
            by_height = by_touched - by_signed
        if "penetration" in slopes:
            by_signed = by_signed - of_terms["penetration"] * slopes["penetration"]
        if "floor" in slopes:
            by_under = of_terms["floor"] * slopes["floor"]
            by_ruler = torch.where(surface.ruler, by_under, by_last)
            by_height, by_last = by_height - by_ruler, by_ruler - by_under
        for foot, of_foot in zip(ctx.feet, of_feet, strict=True):
            if foot is not None:
                by_height = by_height.scatter_add(1, foot, (of_foot / foot.shape[1])[:, None].expand_as(foot))

        by_point = torch.zeros_like(points)
        if surface.normals is not None:
            by_point = (unit * by_signed)[:, None] * surface.normals
            by_scale = by_scale - (by_signed * (ahead if surface.in_scene_units else base)).sum()
            if surface.warp_share is not None:
                by_warp = -(by_signed * base * surface.warp_share).sum(1)
        if surface.plane is not None:
            by_point = by_point + (unit * (by_height + by_last))[:, None] * surface.plane[:, None]
            grown = -(by_height * over).sum() if surface.in_scene_units else by_height.sum() * (surface.offset * reach)
            by_scale = by_scale + grown
        if "mesh" in slopes:
            by_strayed = of_terms["mesh"][..., None] * slopes["mesh"]
            by_point = by_point + by_strayed
            by_pelvis, by_root = -by_strayed.sum(2), -by_strayed @ surface.relative.transpose(1, 2)
        if "depth" in slopes:
            by_log = of_terms["depth"] * slopes["depth"]
            away = points[:, 2]
            by_point[:, 2] += torch.where(away > LEAST_DEPTH_M, by_log / away, torch.zeros_like(away))
            by_offset = -by_log.sum(1)
            by_scale = by_scale + by_offset.sum()
        return None, by_point.transpose(1, 2), by_pelvis, by_root, by_scale, by_offset, by_warp
