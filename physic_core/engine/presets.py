"""Preset "default" of the engine: the joint energy with the best measured results.

Plugins add presets (hook ``physic_engine_presets``).

It minimises Eq. 5 with the terms below, by L-BFGS on whitened parameters. Residuals are divided by
their expected size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physic_core.engine.contact.method import ContactStageMethod
from physic_core.engine.joint.method import JointStageMethod, TermWeight
from physic_core.engine.joint.optimiser import LbfgsOptimiser, Optimiser
from physic_core.engine.joint.sampling import Sampling, with_static_contacts
from physic_core.engine.joint.term import Term
from physic_core.engine.joint.terms.fused_surface import SurfaceTerms
from physic_core.engine.joint.terms.head import HeadTerm
from physic_core.engine.joint.terms.lean import LeanTerm
from physic_core.engine.joint.terms.people import PeopleTerm, SkinContactTerm, mutual_skin_contacts
from physic_core.engine.joint.terms.priors import (
    STATED_WEIGHT,
    LimitTerm,
    RegularisationSettings,
    RegularisationTerm,
    SceneScaleTerm,
    StatureTerm,
)
from physic_core.engine.joint.terms.reprojection_and_depth import (
    DepthSettings,
    DepthTerm,
    ViewsTerm,
    depth_offset_sigmas,
    keypoint_weights,
    robust_reprojection,
)
from physic_core.engine.joint.terms.reprojection_settings import ReprojectionSettings
from physic_core.engine.joint.terms.scene_contact import (
    CONTACT_RANGE_M,
    ContactTerm,
    ContactTermSettings,
    FloorPenetrationTerm,
    PenetrationSettings,
    PenetrationTerm,
    SoleSettings,
    SoleTerm,
)
from physic_core.engine.joint.variables import Variables
from physic_core.engine.placement.method import PlacementStageMethod
from physic_core.engine.scene.method import SceneStageMethod
from physic_core.engine.settings import EngineSettings
from physic_core.engine.sizes.evidence import DEPTH_SCALE_SIGMA
from physic_core.engine.state import State

_LATE_TOLERANCE = 1e-3  # share of the energy, which has converged, in steps with the people term
_ROUGH_FACTOR = 4.0  # of the tolerance, where parts that touch each other move people afterwards


@dataclass(frozen=True)
class DefaultJointStage(JointStageMethod):
    """Settings of stage 3 in preset "default" (paper sec. 3.3, Eq. 5-7).

    A residual is divided by its "sigma", its expected size, and passed to a robust loss: beyond
    "outlier_sigmas" it counts as an outlier. A weight of 0 removes a term.
    """

    optimiser: LbfgsOptimiser = LbfgsOptimiser()
    """L-BFGS on whitened parameters."""
    reprojection: ReprojectionSettings = ReprojectionSettings()
    """Keypoints."""
    depth: DepthSettings = DepthSettings()
    """Depth of the visible surface."""
    contact: ContactTermSettings = ContactTermSettings()
    """Contact with scene and floor, and of hands with other people."""
    penetration: PenetrationSettings = PenetrationSettings()
    """Vertices inside the scene and inside other people."""
    floor: TermWeight = TermWeight(1.8)
    """Vertices below the floor. More than three times as much moved people to floors that are off
    by centimetres (docs/decisions.md).
    """
    soles: SoleSettings = SoleSettings()
    """Feet on the floor."""
    regularisation: RegularisationSettings = RegularisationSettings()
    """Deviation from the start."""
    scene_scale: TermWeight = TermWeight(1.5)
    """Squared change of the scene's scale, in units of its expected size."""
    limits: TermWeight = TermWeight(1.0)
    """Flexion of knees and elbows outside 0 to 2.7 rad."""
    lean: TermWeight = TermWeight(STATED_WEIGHT)
    """Change of the lean towards the camera of people who stand or walk, in units of the error that
    the body estimator states.
    """
    head: TermWeight = TermWeight(1.0)
    """Angle between the direction of the head and that in which the face looks, in units of the
    error that the person observer states.
    """
    stature: TermWeight = TermWeight(STATED_WEIGHT)
    """Deviation of each person's height from the estimated height.

    With the scene's scale, it splits disagreements about size between people and scene. It weighs
    as much as stated rotations: bodies whose joints hardly bend must not change their size instead.
    """

    @property
    def search_radius_m(self) -> float:
        """Search radius of vertices for scene points, metres."""
        return max(CONTACT_RANGE_M, self.penetration.max_depth_m)

    def prepare(self, state: State) -> State:
        """Return the state with static contacts if these are selected."""
        return with_static_contacts(state) if self.contact.source == "static" else state

    def weigh_keypoints(self, state: State) -> Tensor:
        """Return weights by confidence, with less weight on invisible limbs."""
        return keypoint_weights(state)

    def initial_variables(self, sampling: Sampling) -> Variables:
        """Return whitened parameters, with a depth offset for each person."""
        state = sampling.state
        frozen = set(self.frozen)
        offset_sigma = depth_offset_sigmas(self.depth, sampling)
        if "offset" in frozen:
            offset_sigma = torch.zeros_like(offset_sigma)
        if not offset_sigma.any():
            frozen.add("offset")
        surroundings = sampling.surroundings
        if not len(surroundings.points) and surroundings.floor is None:
            frozen.add("scale")  # nothing constrains the scale
        scale_sigma = DEPTH_SCALE_SIGMA if state.scale_sigma is None else state.scale_sigma
        if surroundings.floor is not None:
            scale_sigma = min(scale_sigma, surroundings.floor.height_sigma)
        return Variables(
            state.rotations,
            state.betas,
            state.transl,
            sampling.start.joints[:, 0],
            frozen=sorted(frozen),
            scale_sigma=scale_sigma,
            offset_sigma=offset_sigma,
        )

    def terms(self, sampling: Sampling, variables: Variables) -> Sequence[Term]:
        """Return the terms of the energy, in the order of summation."""
        surface = SurfaceTerms(
            sampling,
            [
                DepthTerm(self.depth, sampling, variables),
                ContactTerm(self.contact, sampling),
                PenetrationTerm(self.penetration, sampling),
                FloorPenetrationTerm(self.floor.weight, sampling),
            ],
            soles=SoleTerm(self.soles, sampling),
            regularisation=RegularisationTerm(self.regularisation, sampling, variables),
        )
        return [
            robust_reprojection(self.reprojection, sampling),
            surface,
            SceneScaleTerm(self.scene_scale.weight),
            LimitTerm(self.limits.weight),
            LeanTerm(self.lean.weight, sampling),
            HeadTerm(self.head.weight, sampling),
            StatureTerm(self.stature.weight, sampling),
            ViewsTerm(self.reprojection, sampling),
        ]

    def late_terms(self, sampling: Sampling) -> tuple[Sequence[Term], Optimiser, Optimiser]:
        """Return the people term, and those of parts that touch each other.

        If used from the start, they would keep people apart on the wrong side of each other.
        """
        terms: list[Term] = []
        if len(sampling.state) > 1:
            terms.append(PeopleTerm(self.contact, self.penetration, sampling))
        tolerance = self.optimiser.tolerance
        if met := mutual_skin_contacts(sampling):
            terms.append(SkinContactTerm(met, sampling))
            rough = replace(self.optimiser, tolerance=_ROUGH_FACTOR * tolerance)
            return terms, rough, self.optimiser
        late = replace(self.optimiser, tolerance=min(tolerance, _LATE_TOLERANCE))
        return terms, self.optimiser, late


DEFAULT = EngineSettings(
    SceneStageMethod(), PlacementStageMethod(), DefaultJointStage(), ContactStageMethod()
)
"""Settings of preset "default"."""
