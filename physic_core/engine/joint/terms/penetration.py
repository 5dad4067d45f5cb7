"""Penetration term L_i: penalty on vertices inside the scene (paper Eq. 7)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.robust_sum import RobustSum
from physic_core.engine.joint.term import Snapshot
from physic_core.types.bounds import NotNegative, Positive

SLACK_M = 0.005
"""Depth without a penalty, metres."""
SURFACE_SIGMA_M = 0.02
"""Expected error of the surface, metres."""
_OUTLIER_SIGMAS = 2.0  # beyond as many the gradient is constant (pseudo-Huber)


@dataclass(frozen=True)
class PenetrationSettings:
    """Settings of the penetration term: vertices inside the scene, along its normals."""

    weight: NotNegative = 0.3
    """Lambda_i of Eq. 5; 0 removes the term."""
    max_depth_m: Positive = 0.15
    """Deeper vertices are skipped, metres."""
    people_weight: NotNegative = 3.0
    """Weight of vertices inside other people (:mod:`physic_core.engine.joint.terms.people`), relative to ``weight``; 0
    skips it."""


class PenetrationTerm:
    """Penetration term: Eq. 7 for visible vertices near the scene and not in free space.

    ``sum_v w_v rho(max(0, -d_v - slack)^2 / sigma^2)``, with signed distance d_v.
    """

    def __init__(self, settings: PenetrationSettings, context: JointContext, *, occlusion_aware: bool) -> None:
        self.settings, self._context, self._occlusion_aware = settings, context, occlusion_aware
        self.weights: dict[str, Tensor] = {}

    def refresh(self, snapshot: Snapshot) -> None:
        """Select the vertices near the scene that are not hidden."""
        contacts, visibility = snapshot.contacts, snapshot.visibility
        near = contacts.found & (contacts.distance < self.settings.max_depth_m) & visibility.eligible
        near = near & ~contacts.in_free_space
        if self._occlusion_aware:
            near = near & ~visibility.hidden
        area = self._context.area
        self.weights = {"penetration": torch.where(near, area, torch.zeros_like(area))}

    def robust_sum(self) -> RobustSum | None:
        """Return the robust sum over penetration depths beyond ``SLACK_M``; None if the term is off."""
        weight = self.settings.weight
        return robust_depths(weight * self.weights["penetration"]) if weight else None


def robust_depths(weight: Tensor) -> RobustSum:
    """Return the robust sum over depths inside a surface, with the weight of each."""
    return RobustSum.of("pseudo_huber", _OUTLIER_SIGMAS, SURFACE_SIGMA_M, weight)
