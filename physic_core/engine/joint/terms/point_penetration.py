"""Penetration as printed, L_i by the distance to the nearest scene point (paper Eq. 7; PROX Eq. 6)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.bounds import NotNegative, Positive
from physic_core.engine.joint.contact_state import ContactState
from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.term import PosedBodies, Rho, View
from physic_core.engine.joint.terms.point_contact import squared_offsets

__all__ = ["PointPenetrationSettings", "PointPenetrationTerm", "point_penetration_energy"]


@dataclass(frozen=True)
class PointPenetrationSettings:
    """Vertices inside the scene, by their nearest scene points.

    Attributes:
        weight: lambda_i; 0 removes the term.
        max_depth_m: deeper vertices are left out, metres.
    """

    weight: NotNegative = 0.3
    max_depth_m: Positive = 1.0


def point_penetration_energy(squared: Tensor, signed: Tensor, weight: Tensor, rho: Rho) -> Tensor:
    """L_i (Eq. 7) as printed: ``sum_v w_v rho(|v - p|^2) [n_p . (v - p) < 0]``, (B, V) each -> (B,)."""
    return (weight * (signed < 0) * rho(squared)).sum(-1)


class PointPenetrationTerm:
    """Vertices on the inner side of their nearest scene point.

    Args:
        settings: of the term.
        context: constants of this optimisation.
        rho: robust loss of square metres.
        takes_part: (view) -> (B, n) bool, vertices that may not penetrate.
        per_axis: the robust loss is applied to each axis (released code).
    """

    def __init__(
        self,
        settings: PointPenetrationSettings,
        context: JointContext,
        rho: Rho,
        takes_part: Callable[[View], Tensor],
        *,
        per_axis: bool = False,
    ) -> None:
        self._settings, self._context, self._rho = settings, context, rho
        self._takes_part, self._per_axis = takes_part, per_axis
        self._contacts: ContactState
        self.active: dict[str, Tensor] = {}

    def refresh(self, view: View) -> None:
        """Select the vertices near the scene."""
        self._contacts = contacts = view.contacts
        near = contacts.found & (contacts.distance < self._settings.max_depth_m) & self._takes_part(view)
        area = self._context.area
        self.active = {"penetration": torch.where(near, area, torch.zeros_like(area))}

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """ "penetration"."""
        weight, contacts, rho = self._settings.weight, self._contacts, self._rho
        if not weight:
            return {}
        signed = torch.zeros_like(self._context.area)
        if contacts.normals is not None and contacts.plane_distance is not None:
            along = (contacts.normals * bodies.vertices).sum(-1)
            signed = along - bodies.estimate.log_scale.exp() * contacts.plane_distance
        squared, active = squared_offsets(bodies, contacts), self.active["penetration"]
        if self._per_axis:
            energy = point_penetration_energy(squared, signed, active, lambda x: rho(x).sum(-1))
        else:
            energy = point_penetration_energy(squared.sum(-1), signed, active, rho)
        return {"penetration": weight * energy}
