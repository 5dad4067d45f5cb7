"""Contact term L_c: distance of contact vertices to the surface of scene and floor (paper Eq. 6)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from physic_core.engine.joint.context import STATIC_CONTACT_PARTS, JointContext
from physic_core.engine.joint.robust_sum import RobustSum
from physic_core.engine.joint.term import Snapshot
from physic_core.engine.joint.terms.penetration import SURFACE_SIGMA_M
from physic_core.types.bounds import NotNegative, Positive

CONTACT_RANGE_M = 0.15
"""Contact vertices farther from scene and floor are skipped, metres."""


@dataclass(frozen=True)
class ContactTermSettings:
    """Settings of the contact term: distances along normals, so that sliding along a surface has no cost."""

    weight: NotNegative = 1.25
    """Lambda_c of Eq. 5; 0 removes the term."""
    source: Literal["prior", "static"] = "prior"
    """Contact vertices: from the "prior", or the "static" parts of every body: feet, hands, thighs, seat and
    back."""
    static_weight: NotNegative = 0.4
    """Weight of static parts without expected contact; 0 removes them."""
    outlier_sigmas: Positive = 3.5
    """Beyond this many sigmas a distance counts as an outlier (Geman-McClure)."""
    people_weight: NotNegative = 0.8
    """Weight of hands on other people (:mod:`physic_core.engine.joint.terms.people`), relative to ``weight``; 0 removes
    it."""


class ContactTerm:
    """Contact term: Eq. 6 for contact vertices near scene or floor that face the nearer of these two surfaces.

    ``sum_v w_v rho(d_v^2 / sigma^2)``, with signed distance d_v; a redescending rho ignores far contacts.

    Attributes:
        prior: (B, n) weight of each vertex by its contact probability.
        on_scene: (B, n) bool, contact is with the scene, otherwise with the floor.
        touching: (B, n) bool, near a surface that the vertex faces, on a visible limb.
    """

    def __init__(self, settings: ContactTermSettings, context: JointContext) -> None:
        self.settings, self._context = settings, context
        probability = context.contact_probability
        prior = torch.where(context.is_contact, probability, torch.zeros_like(probability))
        if settings.static_weight:
            model = context.problem.model
            static = torch.zeros(model.num_vertices, dtype=torch.bool, device=prior.device)
            for name in STATIC_CONTACT_PARTS:
                static[model.contact_sets[name]] = True
            prior = torch.where(static[context.ids], prior.clamp(min=settings.static_weight), prior)
        self.prior = prior * context.problem.weight_of_feet()[:, context.ids]
        self.weights: dict[str, Tensor] = {}
        self.on_scene = self.touching = torch.zeros_like(context.is_contact)

    def refresh(self, snapshot: Snapshot) -> None:
        """Select the vertices near a surface that they face, and weigh them by the cosine between the normals."""
        contacts, reach = snapshot.contacts, CONTACT_RANGE_M
        to_scene, to_floor = contacts.signed.abs(), contacts.height.abs()
        can_scene = contacts.found & (to_scene < reach) & (contacts.facing_scene > 0)
        can_floor = (to_floor < reach) & (contacts.facing_floor > 0)
        self.on_scene = can_scene & (~can_floor | (to_scene <= to_floor))
        self.touching = (can_scene | can_floor) & snapshot.visibility.eligible
        # Only vertices that face a surface can lie on it: the rim of a foot is over the floor without contact.
        cosine = torch.where(self.on_scene, contacts.facing_scene, contacts.facing_floor).clamp(min=0.0)
        weight = self._context.area * self.prior * cosine
        self.weights = {"contact": torch.where(self.touching, weight, torch.zeros_like(weight))}

    def robust_sum(self) -> RobustSum | None:
        """Return the robust sum over distances to the touched surface; None if the term is off."""
        s = self.settings
        if not s.weight:
            return None
        return RobustSum.of("geman_mcclure", s.outlier_sigmas, SURFACE_SIGMA_M, s.weight * self.weights["contact"])
