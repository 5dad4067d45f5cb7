"""Surface terms, evaluated together: depth, contact, penetration, floor, soles and mesh.

They share the distances to scene and floor, and are one node of the graph
(:mod:`physic_core.engine.joint.terms.surface_energies`).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.term import PosedBodies, Snapshot, Term
from physic_core.engine.joint.terms.contact import ContactTerm
from physic_core.engine.joint.terms.depth import DepthTerm
from physic_core.engine.joint.terms.floor import FloorTerm
from physic_core.engine.joint.terms.penetration import PenetrationTerm
from physic_core.engine.joint.terms.regularisation import RegularisationTerm
from physic_core.engine.joint.terms.soles import SoleTerm
from physic_core.engine.joint.terms.surface_energies import SURFACE_ENERGIES, SurfaceInputs, surface_energies

__all__ = ["SurfaceTermGroup", "SurfaceTerms"]


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

    Attributes:
        surface: inputs since the last refresh.
        energies: function of the energies.
    """

    def __init__(self, context: JointContext, parts: SurfaceTermGroup) -> None:
        self.context, self.parts = context, parts
        self.energies = surface_energies
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
            floor_normal=context.floor_normal,
            floor_offset=context.problem.floor_offset,
            last_scale=snapshot.scale,
            soles=context.soles,
        )

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy of each term that is not off: name -> (B,)."""
        parts, surface, e = self.parts, self.surface, bodies.estimate
        values, lowest = self.energies(
            surface, bodies.vertices, bodies.joints[:, 0], e.rotations[:, 0], e.log_scale, e.offset
        )
        sums = (surface.depth, surface.contact, surface.penetration, surface.floor)
        energies = {n: v for n, v, on in zip(SURFACE_ENERGIES, values[:4], sums, strict=False) if on is not None}
        if parts.soles.is_on:
            energies["soles"] = parts.soles.energy(lowest)
        energies["regularisation"] = parts.regularisation.energy(values[4], bodies.deviation)
        return energies
