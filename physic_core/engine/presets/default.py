"""Preset "default": the joint energy with the best measured results.

It minimises Eq. 5 with the terms below, by L-BFGS on whitened parameters. Residuals are divided by their expected size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Literal

import torch

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.conventions import Conventions
from physic_core.engine.joint.settings import JointSettings, LbfgsSettings, VisibilitySettings
from physic_core.engine.joint.state import Spread, State
from physic_core.engine.joint.term import Term
from physic_core.engine.joint.terms.balance import BalanceSettings, BalanceTerm
from physic_core.engine.joint.terms.contact import ContactSettings, ContactTerm
from physic_core.engine.joint.terms.depth import DepthSettings, DepthTerm, offset_sigmas
from physic_core.engine.joint.terms.floor import FloorSettings, FloorTerm
from physic_core.engine.joint.terms.leg_symmetry import LegSymmetrySettings, LegSymmetryTerm
from physic_core.engine.joint.terms.limits import LimitSettings, LimitTerm
from physic_core.engine.joint.terms.penetration import PenetrationSettings, PenetrationTerm
from physic_core.engine.joint.terms.regularisation import RegularisationSettings, RegularisationTerm
from physic_core.engine.joint.terms.reprojection import ReprojectionSettings, ReprojectionTerm, weighted_keypoints
from physic_core.engine.joint.terms.scene_scale import DEPTH_SCALE_SIGMA, SceneScaleSettings, SceneScaleTerm
from physic_core.engine.joint.terms.soles import SoleSettings, SoleTerm
from physic_core.engine.joint.terms.stature import StatureSettings, StatureTerm
from physic_core.engine.joint.terms.surface import SurfaceParts, SurfaceTerms
from physic_core.engine.joint.terms.surface_fused import fused_surface_energies
from physic_core.engine.joint.visibility import update_visibility

__all__ = ["DefaultJoint"]


@dataclass(frozen=True)
class DefaultJoint(JointSettings):
    """Stage 3: pose, hands, shape, translation and scene scale together (paper Sec. 3.3, Eq. 5-7).

    A residual is divided by its "sigma", its expected size, and goes through a robust loss: beyond "outlier_sigmas" it
    counts as an outlier. A weight of 0 removes a term.

    Attributes:
        frozen: parameter groups that are kept constant: root, pose, hands, betas, translation, scale, offset, warp.
        optimiser: L-BFGS on whitened parameters.
        restarts: start poses of each person with a large final reprojection error, the best of which is kept: 1 is the
            estimated pose alone, 3 adds the body tilted by 15 degrees to either side about the camera's horizontal
            axis, 5 adds it 10 % nearer and farther as well.
        visibility: which vertices the photo shows.
        reprojection: keypoints.
        depth: depth of the visible surface.
        contact: contact with scene and floor.
        penetration: vertices inside the scene.
        floor: vertices under the floor.
        soles: feet on the floor.
        regularisation: deviation from the start.
        scene_scale: scale of the scene.
        limits: knees and elbows.
        symmetry: legs that the photo does not show.
        stature: height of people.
        balance: centre of mass over the feet.
    """

    optimiser: LbfgsSettings = field(default_factory=LbfgsSettings)
    restarts: Literal[1, 3, 5] = 3
    visibility: VisibilitySettings = field(default_factory=VisibilitySettings)
    reprojection: ReprojectionSettings = field(default_factory=ReprojectionSettings)
    depth: DepthSettings = field(default_factory=DepthSettings)
    contact: ContactSettings = field(default_factory=ContactSettings)
    penetration: PenetrationSettings = field(default_factory=PenetrationSettings)
    floor: FloorSettings = field(default_factory=FloorSettings)
    soles: SoleSettings = field(default_factory=SoleSettings)
    regularisation: RegularisationSettings = field(default_factory=RegularisationSettings)
    scene_scale: SceneScaleSettings = field(default_factory=SceneScaleSettings)
    limits: LimitSettings = field(default_factory=LimitSettings)
    symmetry: LegSymmetrySettings = field(default_factory=LegSymmetrySettings)
    stature: StatureSettings = field(default_factory=StatureSettings)
    balance: BalanceSettings = field(default_factory=BalanceSettings)

    @property
    def conventions(self) -> Conventions:
        """Vertices count by area, distances are along normals, and the floor is its plane."""
        return Conventions(
            weigh_keypoints=partial(weighted_keypoints, settings=self.reprojection),
            update_visibility=update_visibility,
            search_radius_m=max(self.contact.max_distance_m, self.penetration.max_depth_m),
            facing_deg=self.visibility.facing_deg,
            mask_tolerance=self.visibility.mask_tolerance,
            vertex_spacing_m=self.visibility.vertex_spacing_m,
            static_contacts=self.contact.source == "static",
            coarse_self_occlusion=True,
            along_normals=True,
            free_space=True,
        )

    @property
    def start_poses(self) -> int:
        """The setting ``restarts``."""
        return self.restarts

    def initial_state(self, context: JointContext) -> State:
        """Whitened parameters, with a depth offset and a local scale for each person."""
        problem = context.problem
        frozen = set(self.frozen)
        offset_sigma = offset_sigmas(self.depth, context)
        if "offset" in frozen:
            offset_sigma = torch.zeros_like(offset_sigma)
        if not offset_sigma.any():
            frozen.add("offset")
        if not len(context.surface) or not self.scene_scale.local_sigma:
            frozen.add("warp")
        if not len(context.surface) and problem.floor_normal is None:
            frozen.add("scale")  # nothing constrains the scale
        return State(
            problem.rotations0,
            problem.betas0,
            problem.transl0,
            context.start.joints[:, 0],
            frozen=sorted(frozen),
            spread=Spread(
                scale=DEPTH_SCALE_SIGMA if problem.scale_sigma is None else problem.scale_sigma,
                offset=offset_sigma,
                warp=self.scene_scale.local_sigma,
            ),
            offset_free=offset_sigma > 0,
        )

    def terms(self, context: JointContext, state: State) -> Sequence[Term]:
        """The terms of the energy."""
        aware = self.visibility.occlusion_aware
        contact = ContactTerm(self.contact, context)
        surface = SurfaceParts(
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
            SurfaceTerms(context, state, surface, fused_surface_energies),
            SceneScaleTerm(self.scene_scale.weight),
            LimitTerm(self.limits),
            LegSymmetryTerm(self.symmetry, context),
            StatureTerm(self.stature, context),
            BalanceTerm(self.balance, context, contact),
        ]
