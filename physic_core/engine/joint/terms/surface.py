"""Surface terms, evaluated together: depth, contact, penetration, floor, soles and mesh.

They share the distances to scene and floor. :func:`reference_surface_energies` adds up the equations of the terms.
:func:`physic_core.engine.joint.terms.surface_fused.fused_surface_energies` computes equal values and gradients in one
node of the graph. A preset selects the function ("default" the fused one); tests compare the two.

Distances are divided by the scene's scale, so that shrinking scene and people together does not lower the energy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.distances import lowest_height, plane_height, root_relative
from physic_core.engine.joint.robust_sum import RobustSum
from physic_core.engine.joint.state import State
from physic_core.engine.joint.term import PosedBodies, Snapshot, Term
from physic_core.engine.joint.terms.contact import ContactTerm, contact_energy
from physic_core.engine.joint.terms.depth import DepthTerm, depth_energy
from physic_core.engine.joint.terms.floor import FloorTerm
from physic_core.engine.joint.terms.penetration import PenetrationTerm, penetration_energy
from physic_core.engine.joint.terms.regularisation import RegularisationTerm, mesh_energy
from physic_core.engine.joint.terms.seat import SeatTerm
from physic_core.engine.joint.terms.soles import SoleTerm

__all__ = [
    "SURFACE_ENERGIES",
    "SurfaceFunction",
    "SurfaceInputs",
    "SurfaceTermGroup",
    "SurfaceTerms",
    "reference_surface_energies",
]

SURFACE_ENERGIES = ("depth", "contact", "penetration", "floor", "mesh")


@dataclass(frozen=True)
class SurfaceInputs:
    """Inputs of the surface terms for B people and n subsampled vertices, constant between two refreshes.

    Attributes:
        depth: robust sum over differences of log depth; None if the term is off, as in the next three.
        contact: robust sum over distances to the touched surface.
        penetration: robust sum over depths inside the scene beyond the slack.
        floor: robust sum over depths below the floor.
        mesh_weight: (B, n) of the squared deviation of a vertex from the start, in the root's frame.
        log_map_depth: (B, n) logarithm of the depth map at the vertices.
        on_scene: (B, n) bool, contact is with the scene; else with the floor.
        penetration_slack: metres.
        eligible: (B, n) bool, vertices with a gradient to the floor's scale; the others use ``last_scale``.
        relative: (B, 3, n) at the start in the root's frame, metres.
        normals: (B, 3, n) of the nearest scene points; None without a scene.
        plane_distance: (B, n) from the camera to the planes through those points, unscaled.
        warp_share: (B, n) share of the person's warp that applies to those points; None if warps are frozen.
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
    penetration_slack: float
    eligible: Tensor
    relative: Tensor
    normals: Tensor | None
    plane_distance: Tensor
    warp_share: Tensor | None
    floor_normal: Tensor | None
    floor_offset: float
    last_scale: float
    soles: tuple[Tensor, Tensor]


SurfaceFunction = Callable[[SurfaceInputs, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor], tuple[Tensor, Tensor]]
"""Signature of :func:`reference_surface_energies`."""


def reference_surface_energies(
    data: SurfaceInputs, vertices: Tensor, pelvis: Tensor, root: Tensor, log_scale: Tensor, offset: Tensor, warp: Tensor
) -> tuple[Tensor, Tensor]:
    """Compute the weighted energy of each surface term directly from the term's equation.

    Args:
        data: inputs since the last refresh.
        vertices: (B, n, 3) metres.
        pelvis: (B, 3) metres.
        root: (B, 3, 3) rotation of the root.
        log_scale: () of the scene.
        offset: (B,) logarithm of the depth offset of each person.
        warp: (B,) log of the local depth scale near each person.

    Returns:
        energies: (5, B) of :data:`SURFACE_ENERGIES`, 0 if a term is off.
        lowest: (B, 2) height of the left and the right sole, in the unit of the scene; 0 without a sole.
    """
    scale = log_scale.exp()
    zero = torch.zeros_like(offset)
    energies = dict.fromkeys(SURFACE_ENERGIES, zero)
    signed = height = torch.zeros_like(data.plane_distance)
    if data.normals is not None:
        factor = 1.0 if data.warp_share is None else torch.exp(warp[:, None] * data.warp_share)
        signed = (data.normals.transpose(1, 2) * vertices).sum(-1) / scale - factor * data.plane_distance
    if data.floor_normal is not None:
        height = plane_height(vertices, data.floor_normal, data.floor_offset * scale) / scale
    if data.depth is not None:
        s = data.depth
        mean = depth_energy(vertices[..., 2], data.log_map_depth, s.weight, log_scale, offset, s.sigma, s.rho)
        energies["depth"] = s.weight.sum(1) * mean
    if data.contact is not None:
        s = data.contact
        distance = torch.where(data.on_scene, signed, height)
        energies["contact"] = contact_energy((distance / s.sigma).square(), s.weight, s.rho)
    if data.penetration is not None:
        s = data.penetration
        energies["penetration"] = penetration_energy(signed, s.weight, data.penetration_slack, s.sigma, s.rho)
    if data.floor is not None:
        s = data.floor
        # Invisible legs give the scale no gradient: they use the scale at the last refresh.
        invisible = (height * scale + data.floor_offset * (data.last_scale - scale)) / scale.detach()
        above = torch.where(data.eligible, height, invisible)
        energies["floor"] = penetration_energy(above, s.weight, 0.0, s.sigma, s.rho)
    relative = root_relative(vertices, pelvis, root)
    energies["mesh"] = mesh_energy(relative, data.relative.transpose(1, 2), data.mesh_weight)
    lowest = [lowest_height(height.index_select(1, rows)) if len(rows) else zero for rows in data.soles]
    return torch.stack([energies[name] for name in SURFACE_ENERGIES]), torch.stack(lowest, 1)


@dataclass(frozen=True)
class SurfaceTermGroup:
    """Group of the six terms that :class:`SurfaceTerms` evaluates together."""

    depth: DepthTerm
    contact: ContactTerm
    penetration: PenetrationTerm
    floor: FloorTerm
    soles: SoleTerm
    regularisation: RegularisationTerm

    @property
    def all(self) -> tuple[DepthTerm | ContactTerm | PenetrationTerm | FloorTerm | SoleTerm | RegularisationTerm, ...]:
        """All terms, in the order of the energies."""
        return (self.depth, self.contact, self.penetration, self.floor, self.soles, self.regularisation)


class SurfaceTerms(Term):
    """Depth, contact, penetration, floor, soles and regularisation as one term.

    Args:
        energies: the reference function or the fused one.
        seat: refreshed before this term; the depth map of people with a seat moves with their local depth scale.

    Attributes:
        surface: inputs since the last refresh.
    """

    def __init__(
        self,
        context: JointContext,
        state: State,
        parts: SurfaceTermGroup,
        energies: SurfaceFunction,
        seat: SeatTerm | None = None,
    ) -> None:
        self.context, self.parts, self.energies, self.seat = context, parts, energies, seat
        self._warp_is_free = "warp" in state.free
        self.surface: SurfaceInputs

    def refresh(self, snapshot: Snapshot) -> None:
        """Refresh all terms and collect the inputs of the energies."""
        parts, context, contacts = self.parts, self.context, snapshot.contacts
        for part in parts.all:
            part.refresh(snapshot)
        self.weights = {name: weight for part in parts.all for name, weight in part.weights.items()}
        no_scene = torch.zeros_like(context.area)
        self.surface = SurfaceInputs(
            depth=parts.depth.robust_sum(),
            contact=parts.contact.robust_sum(),
            penetration=parts.penetration.robust_sum(),
            floor=parts.floor.robust_sum(),
            mesh_weight=self.weights["regularisation"],
            log_map_depth=parts.depth.log_map_depth,
            on_scene=parts.contact.on_scene,
            penetration_slack=parts.penetration.settings.slack_m,
            eligible=snapshot.visibility.eligible,
            relative=context.relative.transpose(1, 2).contiguous(),
            normals=contacts.normals.transpose(1, 2).contiguous() if contacts.normals is not None else None,
            plane_distance=contacts.plane_distance if contacts.plane_distance is not None else no_scene,
            warp_share=contacts.warp_share if self._warp_is_free else None,
            floor_normal=context.floor_normal,
            floor_offset=context.problem.floor_offset,
            last_scale=snapshot.scale,
            soles=context.soles,
        )

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy of each term that is not off: name -> (B,)."""
        parts, surface, e = self.parts, self.surface, bodies.estimate
        offset = e.offset
        if self._warp_is_free and self.seat is not None:
            # A person and their seat have one error of depth.
            offset = offset + self.seat.found * e.warp
        values, lowest = self.energies(
            surface, bodies.vertices, bodies.joints[:, 0], e.rotations[:, 0], e.log_scale, offset, e.warp
        )
        sums = (surface.depth, surface.contact, surface.penetration, surface.floor)
        energies = {n: v for n, v, on in zip(SURFACE_ENERGIES, values[:4], sums, strict=False) if on is not None}
        if parts.soles.is_on:
            energies["soles"] = parts.soles.energy(lowest)
        energies["regularisation"] = parts.regularisation.energy(values[4], bodies.deviation)
        return energies
