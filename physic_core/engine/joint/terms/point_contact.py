"""Contact as printed, L_c by the distance to the nearest scene point (paper Eq. 6; PROX Eq. 5)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from physic_core.engine.bounds import NotNegative
from physic_core.engine.joint.contact_state import ContactState
from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.term import PosedBodies, Rho, View
from physic_core.engine.joint.terms.contact import contact_energy

__all__ = ["PointContactSettings", "PointContactTerm", "squared_offsets"]


@dataclass(frozen=True)
class PointContactSettings:
    """Contact with the nearest scene points.

    Attributes:
        weight: lambda_c; 0 removes the term.
        source: contact vertices are those of the "prior", or "static" parts of every body.
    """

    weight: NotNegative = 0.7
    source: Literal["prior", "static"] = "prior"


class PointContactTerm:
    """Contact vertices and their nearest scene points, visible or not.

    Args:
        context: constants of this optimisation.
        weight: lambda_c.
        max_distance_m: vertices farther from the scene are left out, metres.
        rho: robust loss of square metres.
        per_axis: the robust loss is applied to each axis (released code).
        outside_only: only vertices outside the scene count (released code).
        mean: over the vertices that touch, instead of their sum (PROX).
        max_angle_deg: a vertex touches only where its normal and the scene's lie within this angle of one line (PROX).
    """

    def __init__(
        self,
        context: JointContext,
        weight: float,
        max_distance_m: float,
        rho: Rho,
        *,
        per_axis: bool = False,
        outside_only: bool = False,
        mean: bool = False,
        max_angle_deg: float = 90.0,
    ) -> None:
        self._weight, self._reach, self._rho = weight, max_distance_m, rho
        self._per_axis, self._outside_only, self._mean = per_axis, outside_only, mean
        self._least_cosine = math.cos(math.radians(max_angle_deg)) if max_angle_deg < 90 else 0.0
        self._of_vertex = context.area * context.is_contact
        self._contacts: ContactState
        self.active: dict[str, Tensor] = {}

    def refresh(self, view: View) -> None:
        """Select the contact vertices near the scene."""
        self._contacts = contacts = view.contacts
        near = contacts.found & (contacts.distance < self._reach)
        near = near & (contacts.facing_scene.abs() >= self._least_cosine)
        if self._outside_only:
            near = near & (contacts.signed > 0)
        weight = torch.where(near, self._of_vertex, torch.zeros_like(self._of_vertex))
        if self._mean:
            weight = weight / weight.sum(1, keepdim=True).clamp(min=1e-9)
        self.active = {"contact": weight}

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """ "contact"."""
        if not self._weight:
            return {}
        squared = squared_offsets(bodies, self._contacts)
        rho = self._rho
        if self._per_axis:
            return {"contact": self._weight * contact_energy(squared, self.active["contact"], lambda x: rho(x).sum(-1))}
        return {"contact": self._weight * contact_energy(squared.sum(-1), self.active["contact"], rho)}


def squared_offsets(bodies: PosedBodies, contacts: ContactState) -> Tensor:
    """Squared offset from each vertex to its nearest scene point, by axis: (B, n, 3) m^2, 0 without a scene."""
    if contacts.points is None:
        return torch.zeros_like(bodies.vertices)
    return (bodies.vertices - contacts.points * bodies.estimate.log_scale.exp()).square()
