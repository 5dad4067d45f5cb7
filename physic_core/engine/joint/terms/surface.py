"""Surface terms, evaluated together: depth, contact, penetration, floor, soles and mesh.

They share the distances to scene and floor, and are one autograd function with analytic
derivatives. The arrays are small: the overhead of autograd for a hundred operations exceeds their
cost, a quarter of stage 3. Arrays are (B, 3, n), since reductions over a last axis of three are
slow.

Distances are divided by the scene's scale, so that shrinking scene and people together does not
lower the energy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from physic_core.engine.joint.sampling import Sampling
from physic_core.engine.joint.term import PosedBodies, RobustSum, Snapshot, Term
from physic_core.engine.joint.terms.body import RegularisationTerm
from physic_core.engine.joint.terms.picture import MIN_DEPTH_M, DepthTerm
from physic_core.engine.joint.terms.scene import (
    SLACK_M,
    ContactTerm,
    FloorTerm,
    PenetrationTerm,
    SoleTerm,
    lowest_sole_indices,
)

SURFACE_ENERGIES = ("depth", "contact", "penetration", "floor", "mesh")


@dataclass(frozen=True)
class SurfaceInputs:
    """Inputs of the surface terms for B people and n subsampled vertices, constant between two
    refreshes.

    Attributes:
        depth: robust sum over differences of log depth; None if the term is off, as in the next
            three.
        contact: robust sum over distances to the touched surface.
        penetration: robust sum over depths inside the scene beyond the slack.
        floor: robust sum over depths below the floor.
        mesh_weight: (B, n) of the squared deviation of a vertex from the start, in the root's
            frame.
        log_map_depth: (B, n) logarithm of the depth map at the vertices.
        on_scene: (B, n) bool, contact is with the scene, otherwise with the floor.
        eligible: (B, n) bool, vertices with a gradient to the floor's scale; the others use
            ``last_scale``.
        relative: (B, 3, n) at the start in the root's frame, metres.
        normals: (B, 3, n) of the nearest scene points; None without a scene.
        plane_distance: (B, n) from the camera to the planes through those points, unscaled.
        floor_normal: (3,) unit; None without a floor.
        floor_offset: of the floor, metres, unscaled.
        last_scale: of the scene, at the last refresh.
        soles: rows of the left and the right sole's vertices.
    """

    depth: RobustSum | None
    contact: RobustSum | None
    penetration: RobustSum | None
    floor: RobustSum | None
    mesh_weight: Tensor
    log_map_depth: Tensor
    on_scene: Tensor
    eligible: Tensor
    relative: Tensor
    normals: Tensor | None
    plane_distance: Tensor
    floor_normal: Tensor | None
    floor_offset: float
    last_scale: float
    soles: tuple[Tensor, Tensor]


class _SurfaceEnergies(torch.autograd.Function):
    """Weighted energy of each surface term, by the equation of its class; differentiable once.

    Args:
        data: inputs since the last refresh.
        vertices: (B, n, 3) metres.
        pelvis: (B, 3) metres.
        root: (B, 3, 3) rotation of the root.
        log_scale: () of the scene, or (B,) the same for each person, for the derivatives by person.
        offset: (B,) logarithm of the depth offset of each person.

    Returns:
        energies: (5, B) of :data:`SURFACE_ENERGIES`, 0 if a term is off.
        lowest: (B, 2) height of the left and the right sole, in the unit of the scene; 0 without a
            sole.
    """

    @staticmethod
    def forward(ctx: Any, data: SurfaceInputs, *variables: Tensor) -> tuple[Tensor, Tensor]:
        vertices, pelvis, root, log_scale, offset = variables
        points = vertices.transpose(1, 2).contiguous()
        none = torch.zeros_like(offset)
        energies = dict.fromkeys(SURFACE_ENERGIES, none)
        slopes: dict[str, Tensor] = {}
        unit = 1.0 / log_scale.exp().reshape(-1, 1)

        ahead = signed = over = height = torch.zeros_like(data.plane_distance)
        if data.normals is not None:
            ahead = unit * (data.normals * points).sum(1)
            signed = ahead - data.plane_distance
        if data.floor_normal is not None:
            over = unit * (data.floor_normal @ points)
            height = over + data.floor_offset

        if data.depth is not None:
            away = points[:, 2].clamp(min=MIN_DEPTH_M).log()
            residual = away - data.log_map_depth - (log_scale + offset)[:, None]
            energies["depth"], slopes["depth"] = data.depth.value_and_slope(residual)
        if data.contact is not None:
            touched = torch.where(data.on_scene, signed, height)
            energies["contact"], slopes["contact"] = data.contact.value_and_slope(touched)
        if data.penetration is not None:
            inside = torch.relu(-signed - SLACK_M)
            energies["penetration"], slopes["penetration"] = data.penetration.value_and_slope(
                inside
            )
        if data.floor is not None:
            last = over + unit * (data.floor_offset * data.last_scale)
            under = torch.relu(-torch.where(data.eligible, height, last))
            energies["floor"], slopes["floor"] = data.floor.value_and_slope(under)
        # In the camera frame: a rotation does not change the length.
        deviation = (points - pelvis[..., None]) - root @ data.relative
        slopes["mesh"] = 2.0 * data.mesh_weight[:, None] * deviation
        energies["mesh"] = 0.5 * (slopes["mesh"] * deviation).sum((1, 2))
        feet = [
            sole[lowest_sole_indices(height[:, sole])] if len(sole) else None for sole in data.soles
        ]
        lowest = [none if foot is None else height.gather(1, foot).mean(1) for foot in feet]

        ctx.data = data
        ctx.slopes = slopes
        ctx.feet = feet
        ctx.of_scale = log_scale.shape
        ctx.save_for_backward(points, ahead, over, unit)
        return torch.stack([energies[name] for name in SURFACE_ENERGIES]), torch.stack(lowest, 1)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        data: SurfaceInputs = ctx.data
        points, ahead, over, unit = ctx.saved_tensors
        of_terms = dict(zip(SURFACE_ENERGIES, gradients[0][..., None], strict=True))
        of_feet = gradients[1].unbind(1)
        slopes: dict[str, Tensor] = ctx.slopes
        by_scale = torch.zeros_like(points[:, 0, 0])
        by_offset = None

        # Gradients by the distance to the scene, by the height over the floor, and by that height
        # at the last scale.
        by_signed = by_height = by_last = torch.zeros_like(ahead)
        if "contact" in slopes:
            by_touched = of_terms["contact"] * slopes["contact"]
            by_signed = torch.where(data.on_scene, by_touched, by_signed)
            by_height = by_touched - by_signed
        if "penetration" in slopes:
            by_signed = by_signed - of_terms["penetration"] * slopes["penetration"]
        if "floor" in slopes:
            by_under = of_terms["floor"] * slopes["floor"]
            by_eligible = torch.where(data.eligible, by_under, by_last)
            by_height = by_height - by_eligible
            by_last = by_eligible - by_under
        for foot, of_foot in zip(ctx.feet, of_feet, strict=True):
            if foot is not None:
                by_height = by_height.scatter_add(
                    1, foot, (of_foot / foot.shape[1])[:, None].expand_as(foot)
                )

        by_point = torch.zeros_like(points)
        if data.normals is not None:
            by_point = (unit * by_signed)[:, None] * data.normals
            by_scale = by_scale - (by_signed * ahead).sum(1)
        if data.floor_normal is not None:
            by_point = (
                by_point + (unit * (by_height + by_last))[:, None] * data.floor_normal[:, None]
            )
            by_scale = by_scale - (by_height * over).sum(1)
        by_deviation = of_terms["mesh"][..., None] * slopes["mesh"]
        by_point = by_point + by_deviation
        by_pelvis = -by_deviation.sum(2)
        by_root = -by_deviation @ data.relative.transpose(1, 2)
        if "depth" in slopes:
            by_log = of_terms["depth"] * slopes["depth"]
            away = points[:, 2]
            by_point[:, 2] += torch.where(away > MIN_DEPTH_M, by_log / away, torch.zeros_like(away))
            by_offset = -by_log.sum(1)
            by_scale = by_scale + by_offset
        return (
            None,
            by_point.transpose(1, 2),
            by_pelvis,
            by_root,
            by_scale.sum_to_size(ctx.of_scale),
            by_offset,
        )


surface_energies: Callable[
    [SurfaceInputs, Tensor, Tensor, Tensor, Tensor, Tensor], tuple[Tensor, Tensor]
] = _SurfaceEnergies.apply
"""The function of :class:`_SurfaceEnergies`."""


class SurfaceTerms(Term):
    """Depth, contact, penetration, floor, soles and regularisation as one term.

    Attributes:
        surface: inputs since the last refresh.
        energies: function of the energies.
    """

    def __init__(
        self,
        sampling: Sampling,
        depth: DepthTerm,
        contact: ContactTerm,
        penetration: PenetrationTerm,
        floor: FloorTerm,
        soles: SoleTerm,
        regularisation: RegularisationTerm,
    ) -> None:
        self.sampling = sampling
        self.depth = depth
        self.contact = contact
        self.penetration = penetration
        self.floor = floor
        self.soles = soles
        self.regularisation = regularisation
        self.energies = surface_energies
        self.surface: SurfaceInputs

    def refresh(self, snapshot: Snapshot) -> None:
        """Refresh all terms and collect the inputs of the energies."""
        sampling = self.sampling
        contacts = snapshot.contacts
        parts = (
            self.depth,
            self.contact,
            self.penetration,
            self.floor,
            self.soles,
            self.regularisation,
        )
        for part in parts:
            part.refresh(snapshot)
        self.weights = {name: weight for part in parts for name, weight in part.weights.items()}
        no_scene = torch.zeros_like(sampling.area)
        self.surface = SurfaceInputs(
            depth=self.depth.robust_sum(),
            contact=self.contact.robust_sum(),
            penetration=self.penetration.robust_sum(),
            floor=self.floor.robust_sum(),
            mesh_weight=self.weights["regularisation"],
            log_map_depth=self.depth.log_map_depth,
            on_scene=self.contact.on_scene,
            eligible=snapshot.visibility.eligible,
            relative=sampling.relative.transpose(1, 2).contiguous(),
            normals=contacts.normals.transpose(1, 2).contiguous()
            if contacts.normals is not None
            else None,
            plane_distance=contacts.plane_distance
            if contacts.plane_distance is not None
            else no_scene,
            floor_normal=sampling.around.floor_normal,
            floor_offset=sampling.around.floor_offset,
            last_scale=snapshot.scale,
            soles=sampling.soles,
        )

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy of each term that is not off: name -> (B,)."""
        surface = self.surface
        e = bodies.estimate
        values, lowest = self.energies(
            surface, bodies.vertices, bodies.joints[:, 0], e.rotations[:, 0], e.log_scales, e.offset
        )
        sums = (surface.depth, surface.contact, surface.penetration, surface.floor)
        energies = {
            n: v
            for n, v, on in zip(SURFACE_ENERGIES, values[:4], sums, strict=False)
            if on is not None
        }
        if self.soles.is_on:
            energies["soles"] = self.soles.energy(lowest)
        energies["regularisation"] = self.regularisation.energy(values[4], bodies.deviation)
        return energies
