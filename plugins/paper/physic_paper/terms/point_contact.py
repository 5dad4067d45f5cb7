"""Contact term L_c as in the paper: distance to the nearest scene point (Eq. 6; PROX Eq. 5)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from physic_core.engine.joint import ContactState, PosedBodies, RobustLoss, Sampling, Snapshot, Term
from physic_core.types import NotNegative
from physic_paper.terms.reprojection import offset_loss


@dataclass(frozen=True)
class PointContactSettings:
    """Settings of the contact term by distances to the nearest scene points."""

    weight: NotNegative = 0.7
    """Lambda_c; 0 removes the term."""
    source: Literal["prior", "static"] = "prior"
    """Contact vertices are those of the "prior", or "static" parts of every body."""


class PointContactTerm(Term):
    """Contact term: distance of contact vertices, visible or occluded, to their nearest scene
    points.

    Args:
        weight: lambda_c.
        max_distance_m: vertices farther from the scene are skipped, metres.
        rho: robust loss of square metres.
        per_axis: the robust loss is applied to each axis (released code).
        outside_only: only vertices outside the scene count (released code).
        takes_mean: mean over the vertices near the scene, instead of their sum (PROX).
        max_angle_deg: largest angle between the line of the vertex normal and that of the scene
            normal (PROX).
    """

    def __init__(
        self,
        sampling: Sampling,
        weight: float,
        max_distance_m: float,
        rho: RobustLoss,
        *,
        per_axis: bool = False,
        outside_only: bool = False,
        takes_mean: bool = False,
        max_angle_deg: float = 90.0,
    ) -> None:
        self._weight = weight
        self._reach = max_distance_m
        self._rho = rho
        self._per_axis = per_axis
        self._outside_only = outside_only
        self._mean = takes_mean
        self._least_cosine = math.cos(math.radians(max_angle_deg)) if max_angle_deg < 90 else 0.0
        self._of_vertex = sampling.area * sampling.is_contact
        self._contacts: ContactState

    def refresh(self, snapshot: Snapshot) -> None:
        """Select the contact vertices near the scene."""
        self._contacts = contacts = snapshot.contacts
        near = contacts.is_found & (contacts.distance < self._reach)
        near = near & (contacts.facing_scene.abs() >= self._least_cosine)
        if self._outside_only:
            near = near & (contacts.signed > 0)
        weight = torch.where(near, self._of_vertex, torch.zeros_like(self._of_vertex))
        if self._mean:
            weight = weight / weight.sum(1, keepdim=True).clamp(min=1e-9)
        self.weights = {"contact": weight}

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "contact"."""
        if not self._weight:
            return {}
        loss = offset_loss(
            squared_offsets(bodies, self._contacts), self._rho, per_axis=self._per_axis
        )
        return {"contact": self._weight * (self.weights["contact"] * loss).sum(-1)}


def squared_offsets(bodies: PosedBodies, contacts: ContactState) -> Tensor:
    """Return the squared offset of each vertex to its nearest scene point, per axis: (B, n, 3)
    m^2.
    """
    return (bodies.vertices - contacts.points * bodies.estimate.log_scale.exp()).square()
