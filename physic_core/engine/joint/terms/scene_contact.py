"""Terms on scene and floor: penetration (L_i), contact (L_c), vertices below the floor, and
soles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from physic_core.engine.joint.sampling import STATIC_CONTACT_PARTS, Sampling
from physic_core.engine.joint.term import (
    RobustSum,
    Snapshot,
    SurfaceResidual,
    SurfaceSlopes,
    SurfaceTerm,
    VertexDistances,
)
from physic_core.geometry.robust import robust_loss
from physic_core.types.bounds import NotNegative, Positive

SLACK_M = 0.005
"""Depth without a penalty, metres."""
SURFACE_SIGMA_M = 0.02
"""Expected error of the surface, metres."""
OUTLIER_SIGMAS = 2.0
"""Standard deviations from which on a residual counts as an outlier."""

CONTACT_RANGE_M = 0.15
"""Contact vertices farther from scene and floor are skipped, metres."""


@dataclass(frozen=True)
class PenetrationSettings:
    """Settings of the penetration term: vertices inside the scene, along its normals."""

    weight: NotNegative = 0.3
    """Lambda_i of Eq. 5; 0 removes the term."""
    max_depth_m: Positive = 0.15
    """Deeper vertices are skipped, metres."""
    people_weight: NotNegative = 3.0
    """Weight of vertices inside other people (:mod:`physic_core.engine.joint.terms.people`),
    relative to ``weight``; 0 skips it.
    """


class PenetrationTerm(SurfaceTerm):
    """Penetration term: Eq. 7 for visible vertices near the scene and not in free space.

    ``sum_v w_v rho(max(0, -d_v - slack)^2 / sigma^2)``, with signed distance d_v.
    """

    name = "penetration"

    def __init__(self, settings: PenetrationSettings, sampling: Sampling) -> None:
        self.weight = settings.weight
        self._max_depth_m = settings.max_depth_m
        self._sampling = sampling

    def refresh(self, snapshot: Snapshot) -> RobustSum:
        """Select the vertices near the scene that are not hidden."""
        contacts = snapshot.contacts
        visibility = snapshot.visibility
        near = contacts.is_found & (contacts.distance < self._max_depth_m) & visibility.eligible
        near = near & ~contacts.in_free_space
        if self._sampling.visibility.occlusion_aware:
            near = near & ~visibility.hidden
        return robust_depths(self.weight * torch.where(near, self._sampling.area, 0.0))

    def residual(self, at: VertexDistances) -> SurfaceResidual:
        """Return the depths inside the scene beyond ``SLACK_M``."""
        return SurfaceResidual(torch.relu(-at.scene - SLACK_M), SurfaceSlopes(scene=-1.0))


def robust_depths(weight: Tensor) -> RobustSum:
    """Return the robust sum over depths inside a surface, with the weight of each."""
    return RobustSum("pseudo_huber", OUTLIER_SIGMAS, SURFACE_SIGMA_M, weight)


@dataclass(frozen=True)
class ContactTermSettings:
    """Settings of the contact term: distances along normals, so that sliding along a surface has no
    cost.
    """

    weight: NotNegative = 1.25
    """Lambda_c of Eq. 5; 0 removes the term."""
    source: Literal["prior", "static"] = "prior"
    """Contact vertices: from the "prior", or the "static" parts of every body: feet, hands, thighs,
    seat and back.
    """
    static_weight: NotNegative = 0.4
    """Weight of static parts without expected contact; 0 removes them."""
    outlier_sigmas: Positive = 3.5
    """Beyond this many sigmas a distance counts as an outlier (Geman-McClure)."""
    people_weight: NotNegative = 0.8
    """Weight of hands on other people (:mod:`physic_core.engine.joint.terms.people`), relative to
    ``weight``; 0 removes it.
    """


class ContactTerm(SurfaceTerm):
    """Contact term: Eq. 6 for contact vertices near scene or floor that face the nearer of these
    two surfaces.

    ``sum_v w_v rho(d_v^2 / sigma^2)``, with signed distance d_v; a redescending rho ignores far
    contacts.

    Attributes:
        prior: (B, n) weight of each vertex by its contact probability.
        on_scene: (B, n) bool, contact is with the scene, otherwise with the floor.
    """

    name = "contact"

    def __init__(self, settings: ContactTermSettings, sampling: Sampling) -> None:
        self.weight = settings.weight
        self._outlier_sigmas = settings.outlier_sigmas
        self._sampling = sampling
        prior = torch.where(sampling.is_contact, sampling.contact_prior, 0.0)
        if settings.static_weight:
            static = sampling.state.model.contact_set_mask(*STATIC_CONTACT_PARTS)
            prior = torch.where(
                static[sampling.ids], prior.clamp(min=settings.static_weight), prior
            )
        self.prior = prior * sampling.state.touch_weights()[:, sampling.ids]
        self.on_scene: Tensor

    def refresh(self, snapshot: Snapshot) -> RobustSum:
        """Select the vertices near a surface that they face, and weigh them by the cosine between
        the normals.
        """
        contacts = snapshot.contacts
        reach = CONTACT_RANGE_M
        to_scene = contacts.signed.abs()
        to_floor = contacts.height.abs()
        can_scene = contacts.is_found & (to_scene < reach) & (contacts.facing_scene > 0)
        can_floor = (to_floor < reach) & (contacts.facing_floor > 0)
        self.on_scene = can_scene & (~can_floor | (to_scene <= to_floor))
        touching = (can_scene | can_floor) & snapshot.visibility.eligible
        # Only vertices that face a surface can lie on it: the rim of a foot is over the floor
        # without contact.
        cosine = torch.where(self.on_scene, contacts.facing_scene, contacts.facing_floor).clamp(
            min=0.0
        )
        weight = torch.where(touching, self._sampling.area * self.prior * cosine, 0.0)
        return RobustSum(
            "geman_mcclure", self._outlier_sigmas, SURFACE_SIGMA_M, self.weight * weight
        )

    def residual(self, at: VertexDistances) -> SurfaceResidual:
        """Return the distances to the touched surface."""
        touched = torch.where(self.on_scene, at.scene, at.floor)
        return SurfaceResidual(touched, SurfaceSlopes(self.on_scene, ~self.on_scene))


# Expected error of the plane, metres. A foot more than about 3 cm over it is an outlier.
_PLANE_SIGMA_M = 0.015
_UNSEEN_FLOOR_SHARE = 0.3  # of the weight, for invisible limbs
# Invisible limbs of people with deeper vertices have no weight: leg pose or floor is wrong.
_MAX_FLOOR_DEPTH_M = 0.2


class FloorPenetrationTerm(SurfaceTerm):
    """Floor term: depth of all vertices below the floor's plane.

    Attributes:
        eligible: (B, n) bool, vertices on limbs that the photo shows.
    """

    name = "floor"

    def __init__(self, weight: float, sampling: Sampling) -> None:
        self.weight = 0.0 if sampling.surroundings.floor is None else weight
        self._sampling = sampling
        self.eligible: Tensor

    def refresh(self, snapshot: Snapshot) -> RobustSum:
        """Update the weights: full weight on visible limbs, less on invisible ones."""
        area = self._sampling.area
        self.eligible = snapshot.visibility.eligible
        below = -snapshot.contacts.height.amin(1, keepdim=True).clamp(max=0.0)
        invisible = torch.where(below < _MAX_FLOOR_DEPTH_M, _UNSEEN_FLOOR_SHARE * area, 0.0)
        weight = torch.where(self.eligible, area, invisible)
        # People far below contradict the floor or the scene's scale, and must not draw it away from
        # the others.
        weight = weight / (1 + (below / _MAX_FLOOR_DEPTH_M).square())
        return RobustSum("pseudo_huber", OUTLIER_SIGMAS, _PLANE_SIGMA_M, self.weight * weight)

    def residual(self, at: VertexDistances) -> SurfaceResidual:
        """Return the depths below the floor; invisible limbs give its scale no gradient."""
        under = torch.relu(-torch.where(self.eligible, at.floor, at.last_floor))
        by_floor = -self.eligible.to(under)
        return SurfaceResidual(under, SurfaceSlopes(floor=by_floor, last_floor=-1.0 - by_floor))


@dataclass(frozen=True)
class SoleSettings:
    """Settings of the sole term: mean height above the floor of the lowest 5 % of a sole's
    vertices.
    """

    weight: NotNegative = 0.6
    """Weight of each visible foot near the floor; the lower one has twice as much again, up to a
    larger height. Like the floor term, it is small against the picture: the plane is off by
    centimetres.
    """
    unseen_weight: NotNegative = 4.0
    """Weight of each invisible foot; most feet stand on the floor."""


_LOWEST_SHARE = 0.05  # of a sole's vertices: on tiptoe only this share touches the floor


def lowest_sole_indices(height: Tensor) -> Tensor:
    """Return the indices of the lowest 5 % of the vertices of a foot's sole: heights (B, n) -> (B,
    n / 20) int64.
    """
    count = max(1, round(_LOWEST_SHARE * height.shape[-1]))
    return height.topk(count, dim=-1, largest=False).indices


def lowest_height(height: Tensor) -> Tensor:
    """Return the mean height of the lowest 5 % of a sole's vertices: (B, n) -> (B,) metres."""
    return height.gather(-1, lowest_sole_indices(height)).mean(-1)


_LOWER_SIGMA_M = 0.04


def sole_energy(lowest: Tensor, weight: Tensor, lower_weight: Tensor) -> Tensor:
    """Return the sole energy (B,): ``sum_f w_f near(h_f^2) + w far(min_f h_f^2)`` with robust
    losses near and far.

    ``near`` redescends within centimetres, so that a foot in the air gets no gradient. ``far`` does
    not redescend. It applies only to the lower foot: a person who stands, walks or runs has at most
    one foot far from the ground.

    Args:
        lowest: (B, 2) height of the left and the right sole, metres.
        weight: (B, 2), 0 for an invisible foot.
        lower_weight: (B,), 0 for people who may float (invisible feet, or no expected contact).
    """
    weighted = weight > 0
    lower = torch.where(weighted, lowest, torch.inf).amin(-1)
    # 0 * inf is NaN
    lower = torch.where(weighted.any(-1), lower, 0.0)
    near = robust_loss("geman_mcclure", lowest.square() / _PLANE_SIGMA_M**2, OUTLIER_SIGMAS)
    far = robust_loss("cauchy", lower.square() / _LOWER_SIGMA_M**2, OUTLIER_SIGMAS)
    return (weight * near).sum(-1) + lower_weight * far


_LOWER_WEIGHT = 2.0  # of the lower visible foot, in weights of each foot
_MAX_LOWER_HEIGHT_M = 0.4  # a lower foot at a larger height is skipped
_UNSEEN_SIGMA_M = 0.05
_UNSEEN_OUTLIER_SIGMAS = 3.0
_MAX_UNSEEN_SIGMAS = 4.0  # an invisible foot at a larger height is skipped


class SoleTerm:
    """Sole term, which
    :class:`physic_core.engine.joint.terms.fused_surface.SurfaceTerms` evaluates.
    """

    def __init__(self, settings: SoleSettings, sampling: Sampling) -> None:
        self._settings = settings
        self._sampling = sampling
        self._all_seen = bool(sampling.feet_visible.all())
        self.weights: dict[str, Tensor] = {}
        weighs = bool(settings.weight or settings.unseen_weight)
        self.is_on = weighs and sampling.surroundings.floor is not None

    def refresh(self, snapshot: Snapshot) -> None:
        """Weigh the visible feet by their touch, and select people whose lower foot is expected to
        touch the floor.
        """
        sampling = self._sampling
        height = snapshot.contacts.height
        lowest = torch.stack([lowest_height(height[:, rows]) for rows in sampling.soles], 1)
        on_floor = sampling.feet_visible & torch.isfinite(lowest)
        is_likely_contact = torch.stack(
            [sampling.is_contact[:, rows].any(1) for rows in sampling.soles], 1
        )
        lower = torch.where(on_floor, lowest, torch.inf).amin(1)
        pulled = (on_floor & is_likely_contact).any(1) & (lower.abs() < _MAX_LOWER_HEIGHT_M)
        unseen = ~sampling.feet_visible & (lowest.abs() < _MAX_UNSEEN_SIGMAS * _UNSEEN_SIGMA_M)
        touch = torch.ones_like(lowest)
        either = torch.ones_like(lowest[:, 0])
        if sampling.state.limb_touch_probability is not None:
            touch = sampling.state.limb_touch_probability[:, :2].to(lowest)
            either = 1 - (1 - touch).prod(1)
        self.weights = {
            "soles": touch * on_floor,
            "lower_sole": either * pulled,
            "unseen_soles": unseen.to(lowest),
        }

    def energy(self, lowest: Tensor) -> Tensor:
        """Return the sole energy (B,) for the heights (B, 2) of the left and the right sole,
        metres.
        """
        s = self._settings
        weight = s.weight * self.weights["soles"]
        lower_weight = _LOWER_WEIGHT * s.weight * self.weights["lower_sole"]
        soles = sole_energy(lowest, weight, lower_weight)
        if self._all_seen:
            return soles
        unseen = robust_loss(
            "geman_mcclure", (lowest / _UNSEEN_SIGMA_M).square(), _UNSEEN_OUTLIER_SIGMAS
        )
        return soles + s.unseen_weight * (self.weights["unseen_soles"] * unseen).sum(1)
