"""Preset "default": the joint energy with the best measured results.

It minimises Eq. 5 with the terms below, by L-BFGS on whitened parameters. Residuals are divided by their expected size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from physic_core.engine.joint.context import JointContext, Keypoints
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.energy_options import EnergyOptions
from physic_core.engine.joint.optimiser import LbfgsSettings, MinimisationResult, join_results
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.joint.settings import JointSettings, Progress, VisibilitySettings
from physic_core.engine.joint.state import State, StateSigmas
from physic_core.engine.joint.term import Term
from physic_core.engine.joint.terms.balance import BalanceSettings, BalanceTerm
from physic_core.engine.joint.terms.contact import ContactSettings, ContactTerm
from physic_core.engine.joint.terms.depth import DepthSettings, DepthTerm, depth_offset_sigmas
from physic_core.engine.joint.terms.floor import FloorSettings, FloorTerm
from physic_core.engine.joint.terms.limits import LimitSettings, LimitTerm
from physic_core.engine.joint.terms.penetration import PenetrationSettings, PenetrationTerm
from physic_core.engine.joint.terms.people import PeopleTerm
from physic_core.engine.joint.terms.regularisation import RegularisationSettings, RegularisationTerm
from physic_core.engine.joint.terms.reprojection import ReprojectionSettings, ReprojectionTerm, weighted_keypoints
from physic_core.engine.joint.terms.scene_scale import DEPTH_SCALE_SIGMA, SceneScaleSettings, SceneScaleTerm
from physic_core.engine.joint.terms.soles import SoleSettings, SoleTerm
from physic_core.engine.joint.terms.stature import StatureSettings, StatureTerm
from physic_core.engine.joint.terms.surface import SurfaceTermGroup, SurfaceTerms

__all__ = ["DefaultOptimisation"]

_LATE_TOLERANCE = 1e-3  # of the steps with the people term, a small share of an energy that has converged


@dataclass(frozen=True)
class DefaultOptimisation(JointSettings):
    """Settings of stage 3 in preset "default" (paper sec. 3.3, Eq. 5-7).

    A residual is divided by its "sigma", its expected size, and goes through a robust loss: beyond "outlier_sigmas" it
    counts as an outlier. A weight of 0 removes a term.

    Attributes:
        frozen: parameter groups that are kept constant: root, pose, hands, betas, translation, scale, offset.
    """

    optimiser: LbfgsSettings = field(default_factory=LbfgsSettings)
    """L-BFGS on whitened parameters."""
    visibility: VisibilitySettings = field(default_factory=VisibilitySettings)
    """Visibility of vertices."""
    reprojection: ReprojectionSettings = field(default_factory=ReprojectionSettings)
    """Keypoints."""
    depth: DepthSettings = field(default_factory=DepthSettings)
    """Depth of the visible surface."""
    contact: ContactSettings = field(default_factory=ContactSettings)
    """Contact with scene and floor, and of hands with other people."""
    penetration: PenetrationSettings = field(default_factory=PenetrationSettings)
    """Vertices inside the scene and inside other people."""
    floor: FloorSettings = field(default_factory=FloorSettings)
    """Vertices under the floor."""
    soles: SoleSettings = field(default_factory=SoleSettings)
    """Feet on the floor."""
    regularisation: RegularisationSettings = field(default_factory=RegularisationSettings)
    """Deviation from the start."""
    scene_scale: SceneScaleSettings = field(default_factory=SceneScaleSettings)
    """Scale of the scene."""
    limits: LimitSettings = field(default_factory=LimitSettings)
    """Knees and elbows."""
    stature: StatureSettings = field(default_factory=StatureSettings)
    """Height of people."""
    balance: BalanceSettings = field(default_factory=BalanceSettings)
    """Centre of mass over the feet."""

    @property
    def energy_options(self) -> EnergyOptions:
        """Options of the energy: vertices weighted by area, distances along normals, the floor as a plane, people by
        their visible size."""
        return EnergyOptions(
            search_radius_m=max(self.contact.max_distance_m, self.penetration.max_depth_m),
            facing_deg=self.visibility.facing_deg,
            mask_tolerance=self.visibility.mask_tolerance,
            vertex_spacing_m=self.visibility.vertex_spacing_m,
            static_contacts=self.contact.source == "static",
            coarse_self_occlusion=True,
            along_normals=True,
            free_space=True,
            people_by_size=True,
        )

    def weigh_keypoints(self, problem: JointProblem, person_px: Tensor) -> Keypoints:
        """Return the keypoints with weights from confidence, reduced for low confidence and for invisible limbs."""
        return weighted_keypoints(problem, person_px, self.reprojection)

    def initial_state(self, context: JointContext) -> State:
        """Return whitened parameters, with a depth offset for each person."""
        problem = context.problem
        frozen = set(self.frozen)
        offset_sigma = depth_offset_sigmas(self.depth, context)
        if "offset" in frozen:
            offset_sigma = torch.zeros_like(offset_sigma)
        if not offset_sigma.any():
            frozen.add("offset")
        if not len(context.surface) and problem.floor_normal is None:
            frozen.add("scale")  # nothing constrains the scale
        return State(
            problem.rotations0,
            problem.betas0,
            problem.transl0,
            context.start.joints[:, 0],
            frozen=sorted(frozen),
            sigmas=StateSigmas(
                scale=DEPTH_SCALE_SIGMA if problem.scale_sigma is None else problem.scale_sigma,
                offset=offset_sigma,
            ),
            offset_free=offset_sigma > 0,
        )

    def terms(self, context: JointContext, state: State) -> Sequence[Term]:
        """Return the terms of the energy, in the order of summation."""
        aware = self.visibility.occlusion_aware
        contact = ContactTerm(self.contact, context)
        surface = SurfaceTermGroup(
            depth=DepthTerm(self.depth, context, state),
            contact=contact,
            penetration=PenetrationTerm(self.penetration, context, occlusion_aware=aware),
            floor=FloorTerm(self.floor, context),
            soles=SoleTerm(self.soles, context),
            regularisation=RegularisationTerm(self.regularisation, context, state, occlusion_aware=aware),
        )
        keypoints = self.reprojection
        return [
            ReprojectionTerm(context, keypoints.weight, context.person_px[:, None] * keypoints.sigma, keypoints.rho()),
            SurfaceTerms(context, surface),
            SceneScaleTerm(self.scene_scale.weight),
            LimitTerm(self.limits),
            StatureTerm(self.stature, context),
            BalanceTerm(self.balance, context, contact),
        ]

    def minimise(self, energy: JointEnergy, progress: Progress | None = None) -> MinimisationResult:
        """Minimise the energy, then once more with the people term, if people are near each other.

        From the start, that term would keep apart people who start on the wrong side of each other.
        """
        origin = energy.state.pack()
        result = self.optimiser.minimise(energy, progress)
        groups = energy.add_terms([PeopleTerm(self.contact, self.penetration, energy.context)])
        if groups is None:
            return result
        late = replace(self.optimiser, tolerance=min(self.optimiser.tolerance, _LATE_TOLERANCE))
        return join_results(energy, origin, result, late.minimise(energy, groups=groups))
