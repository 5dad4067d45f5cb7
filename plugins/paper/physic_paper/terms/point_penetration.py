"""Penetration term L_i as in the paper: distance to the nearest scene point (Eq. 7; PROX Eq. 6)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.joint import ContactState, PosedBodies, RobustLoss, Sampling, Snapshot, Term
from physic_core.types import NotNegative, Positive
from physic_paper.terms.point_contact import squared_offsets
from physic_paper.terms.reprojection import offset_loss


@dataclass(frozen=True)
class PointPenetrationSettings:
    """Settings of the penetration term by distances to the nearest scene points."""

    weight: NotNegative = 0.3
    """Lambda_i; 0 removes the term."""
    max_depth_m: Positive = 1.0
    """Deeper vertices are skipped, metres."""


def point_penetration_energy(loss: Tensor, signed: Tensor, weight: Tensor) -> Tensor:
    """Return L_i (Eq. 7 of the paper): ``sum_v w_v rho(|v - p|^2) [n_p . (v - p) < 0]``, (B, V)
    each -> (B,).

    ``loss`` is ``rho(|v - p|^2)``, ``signed`` is ``n_p . (v - p)``.
    """
    return (weight * (signed < 0) * loss).sum(-1)


class PointPenetrationTerm(Term):
    """Penetration term: vertices on the inner side of their nearest scene point.

    Args:
        rho: robust loss of square metres.
        may_not_penetrate: (snapshot) -> (B, n) bool, vertices that are penalised inside the scene.
        per_axis: the robust loss is applied to each axis (released code).
    """

    def __init__(
        self,
        settings: PointPenetrationSettings,
        sampling: Sampling,
        rho: RobustLoss,
        may_not_penetrate: Callable[[Snapshot], Tensor],
        *,
        per_axis: bool = False,
    ) -> None:
        self._settings = settings
        self._sampling = sampling
        self._rho = rho
        self._may_not_penetrate = may_not_penetrate
        self._per_axis = per_axis
        self._contacts: ContactState

    def refresh(self, snapshot: Snapshot) -> None:
        """Select the vertices near the scene."""
        self._contacts = contacts = snapshot.contacts
        near = (
            contacts.is_found
            & (contacts.distance < self._settings.max_depth_m)
            & self._may_not_penetrate(snapshot)
        )
        area = self._sampling.area
        self.weights = {"penetration": torch.where(near, area, torch.zeros_like(area))}

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "penetration"."""
        weight = self._settings.weight
        contacts = self._contacts
        if not weight:
            return {}
        along = (contacts.normals * bodies.vertices).sum(-1)
        signed = along - bodies.estimate.log_scale.exp() * contacts.plane_distance
        loss = offset_loss(squared_offsets(bodies, contacts), self._rho, per_axis=self._per_axis)
        return {
            "penetration": weight
            * point_penetration_energy(loss, signed, self.weights["penetration"])
        }
