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
from physic_core.engine.joint.method import JointMethod
from physic_core.engine.joint.optimiser import LbfgsOptimiser, Optimiser
from physic_core.engine.joint.sampling import Sampling, WeightedKeypoints, with_static_contacts
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
from physic_core.engine.joint.terms.lean import LeanSettings, LeanTerm
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
from physic_core.engine.joint.variables import Variables
from physic_core.engine.placement.method import PlacementMethod
from physic_core.engine.scene.method import SceneMethod
from physic_core.engine.settings import EngineSettings
from physic_core.engine.sizes.evidence import DEPTH_SCALE_SIGMA
from physic_core.engine.state import State

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
    lean: LeanSettings = field(default_factory=LeanSettings)
    """Lean of people who stand or walk."""
    stature: StatureSettings = field(default_factory=StatureSettings)
    """Height of people."""

    @property
    def search_radius_m(self) -> float:
        """Search radius of vertices for scene points, metres."""
        return max(CONTACT_RANGE_M, self.penetration.max_depth_m)

    def prepare(self, state: State) -> State:
        """Return the state with static contacts if these are selected."""
        return with_static_contacts(state) if self.contact.source == "static" else state

    def weigh_keypoints(self, state: State) -> WeightedKeypoints:
        """Return the keypoints, weighted by confidence, with less weight on invisible limbs."""
        return weighted_keypoints(state)

    def initial_variables(self, sampling: Sampling) -> Variables:
        """Return whitened parameters, with a depth offset for each person."""
        state = sampling.state
        frozen = set(self.frozen)
        offset_sigma = depth_offset_sigmas(self.depth, sampling)
        if "offset" in frozen:
            offset_sigma = torch.zeros_like(offset_sigma)
        if not offset_sigma.any():
            frozen.add("offset")
        around = sampling.around
        if not len(around.points) and around.floor_normal is None:
            frozen.add("scale")  # nothing constrains the scale
        return Variables(
            state.rotations,
            state.betas,
            state.transl,
            sampling.start.joints[:, 0],
            frozen=sorted(frozen),
            scale_sigma=DEPTH_SCALE_SIGMA if state.scale_sigma is None else state.scale_sigma,
            offset_sigma=offset_sigma,
        )

    def terms(self, sampling: Sampling, variables: Variables) -> Sequence[Term]:
        """Return the terms of the energy, in the order of summation."""
        aware = self.visibility.occlusion_aware
        surface = SurfaceTerms(
            sampling,
            [
                DepthTerm(self.depth, sampling, variables),
                ContactTerm(self.contact, sampling),
                PenetrationTerm(self.penetration, sampling, occlusion_aware=aware),
                FloorTerm(self.floor, sampling),
            ],
            soles=SoleTerm(self.soles, sampling),
            regularisation=RegularisationTerm(
                self.regularisation, sampling, variables, occlusion_aware=aware
            ),
        )
        keypoints = self.reprojection
        return [
            ReprojectionTerm(
                sampling,
                keypoints.weight,
                sampling.person_px[:, None] * keypoints.sigma,
                keypoints.rho(),
            ),
            surface,
            SceneScaleTerm(self.scene_scale.weight),
            LimitTerm(self.limits),
            LeanTerm(self.lean, sampling),
            StatureTerm(self.stature, sampling),
            ViewsTerm(keypoints, sampling),
        ]

    def late_terms(self, sampling: Sampling) -> tuple[Sequence[Term], Optimiser]:
        """Return the people term.

        If used from the start, it would keep people apart on the wrong side of each other.
        """
        late = replace(self.optimiser, tolerance=min(self.optimiser.tolerance, _LATE_TOLERANCE))
        return [PeopleTerm(self.contact, self.penetration, sampling)], late


DEFAULT = EngineSettings(SceneMethod(), PlacementMethod(), DefaultOptimisation(), ContactMethod())
"""Settings of preset "default"."""
