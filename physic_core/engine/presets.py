"""Preset "default" of the engine: the joint energy with the best measured results.

Plugins add presets (hook ``physic_engine_presets``).

It minimises Eq. 5 with the terms below, by L-BFGS on whitened parameters. Residuals are divided by
their expected size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import torch

from physic_core.engine.contact.method import ContactMethod
from physic_core.engine.joint.context import JointContext, WeightedKeypoints, with_static_contacts
from physic_core.engine.joint.method import JointMethod
from physic_core.engine.joint.optimiser import LbfgsOptimiser, Optimiser
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.joint.state import State
from physic_core.engine.joint.term import Term
from physic_core.engine.joint.terms.body import (
    LimitSettings,
    LimitTerm,
    RegularisationSettings,
    RegularisationTerm,
    SceneScaleSettings,
    SceneScaleTerm,
    StatureSettings,
    StatureTerm,
)
from physic_core.engine.joint.terms.people import PeopleTerm
from physic_core.engine.joint.terms.picture import (
    DepthSettings,
    DepthTerm,
    ReprojectionSettings,
    ReprojectionTerm,
    ViewsTerm,
    depth_offset_sigmas,
    weighted_keypoints,
)
from physic_core.engine.joint.terms.scene import (
    CONTACT_RANGE_M,
    ContactTerm,
    ContactTermSettings,
    FloorSettings,
    FloorTerm,
    PenetrationSettings,
    PenetrationTerm,
    SoleSettings,
    SoleTerm,
)
from physic_core.engine.joint.terms.surface import SurfaceTerms
from physic_core.engine.placement.method import PlacementMethod
from physic_core.engine.scene.method import SceneMethod
from physic_core.engine.settings import EngineSettings
from physic_core.engine.sizes.evidence import DEPTH_SCALE_SIGMA

# of the steps with the people term, a small share of an energy that has converged
_LATE_TOLERANCE = 1e-3


@dataclass(frozen=True)
class DefaultOptimisation(JointMethod):
    """Settings of stage 3 in preset "default" (paper sec. 3.3, Eq. 5-7).

    A residual is divided by its "sigma", its expected size, and passed to a robust loss: beyond
    "outlier_sigmas" it counts as an outlier. A weight of 0 removes a term.
    """

    optimiser: LbfgsOptimiser = field(default_factory=LbfgsOptimiser)
    """L-BFGS on whitened parameters."""
    reprojection: ReprojectionSettings = field(default_factory=ReprojectionSettings)
    """Keypoints."""
    depth: DepthSettings = field(default_factory=DepthSettings)
    """Depth of the visible surface."""
    contact: ContactTermSettings = field(default_factory=ContactTermSettings)
    """Contact with scene and floor, and of hands with other people."""
    penetration: PenetrationSettings = field(default_factory=PenetrationSettings)
    """Vertices inside the scene and inside other people."""
    floor: FloorSettings = field(default_factory=FloorSettings)
    """Vertices below the floor."""
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

    @property
    def search_radius_m(self) -> float:
        """Search radius of vertices for scene points, metres."""
        return max(CONTACT_RANGE_M, self.penetration.max_depth_m)

    def prepare(self, problem: JointProblem) -> JointProblem:
        """Return the problem with the scene points that have a normal, and with static contacts if
        selected.
        """
        problem = super().prepare(problem)
        return with_static_contacts(problem) if self.contact.source == "static" else problem

    def weigh_keypoints(self, problem: JointProblem) -> WeightedKeypoints:
        """Return the keypoints, weighted by confidence, with less weight on invisible limbs."""
        return weighted_keypoints(problem)

    def initial_state(self, context: JointContext) -> State:
        """Return whitened parameters, with a depth offset for each person."""
        problem = context.problem
        frozen = set(self.frozen)
        offset_sigma = depth_offset_sigmas(self.depth, context)
        if "offset" in frozen:
            offset_sigma = torch.zeros_like(offset_sigma)
        if not offset_sigma.any():
            frozen.add("offset")
        if not len(problem.scene_points) and problem.floor_normal is None:
            frozen.add("scale")  # nothing constrains the scale
        return State(
            problem.rotations0,
            problem.betas0,
            problem.transl0,
            context.start.joints[:, 0],
            frozen=sorted(frozen),
            scale_sigma=DEPTH_SCALE_SIGMA if problem.scale_sigma is None else problem.scale_sigma,
            offset_sigma=offset_sigma,
        )

    def terms(self, context: JointContext, state: State) -> Sequence[Term]:
        """Return the terms of the energy, in the order of summation."""
        aware = self.visibility.occlusion_aware
        surface = SurfaceTerms(
            context,
            depth=DepthTerm(self.depth, context, state),
            contact=ContactTerm(self.contact, context),
            penetration=PenetrationTerm(self.penetration, context, occlusion_aware=aware),
            floor=FloorTerm(self.floor, context),
            soles=SoleTerm(self.soles, context),
            regularisation=RegularisationTerm(
                self.regularisation, context, state, occlusion_aware=aware
            ),
        )
        keypoints = self.reprojection
        return [
            ReprojectionTerm(
                context,
                keypoints.weight,
                context.person_px[:, None] * keypoints.sigma,
                keypoints.rho(),
            ),
            surface,
            SceneScaleTerm(self.scene_scale.weight),
            LimitTerm(self.limits),
            StatureTerm(self.stature, context),
            ViewsTerm(keypoints, context),
        ]

    def late_terms(self, context: JointContext) -> tuple[Sequence[Term], Optimiser]:
        """Return the people term.

        If used from the start, it would keep people apart on the wrong side of each other.
        """
        late = replace(self.optimiser, tolerance=min(self.optimiser.tolerance, _LATE_TOLERANCE))
        return [PeopleTerm(self.contact, self.penetration, context)], late


DEFAULT = EngineSettings(SceneMethod(), PlacementMethod(), DefaultOptimisation(), ContactMethod())
"""Settings of preset "default"."""
