"""Preset "prox": the joint energy of PROX (Hassan et al., ICCV 2019), the baseline of the paper.

Deviations from the publication:

- The scene is an unprojected depth map, as in the paper's comparison.
- The pose prior is the distance to the estimated pose, instead of VPoser.
- The seven phases are two: without and with the scene.
- The exponential bending prior is a one-sided limit.
- Nearest scene points are searched within half a metre, and the body's vertices are subsampled.
- Self-penetration, jaw and expression are left out.
- Neck and hip keypoints, which PROX ignores, count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar

import torch
from torch import Tensor

from physic_core.engine.bounds import FrozenGroups, NotNegative
from physic_core.engine.joint.acceptance import term_totals
from physic_core.engine.joint.context import JointContext, Keypoints
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.energy_options import EnergyOptions
from physic_core.engine.joint.optimiser import LbfgsSettings, MinimisationResult
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.joint.settings import JointSettings, Progress
from physic_core.engine.joint.state import State
from physic_core.engine.joint.term import Term
from physic_core.engine.joint.terms.limits import LimitSettings, LimitTerm
from physic_core.geometry.robust import robust_loss
from physic_paper.terms.point_contact import PointContactTerm
from physic_paper.terms.point_penetration import PointPenetrationSettings, PointPenetrationTerm
from physic_paper.terms.printed_regularisation import ParameterPriorTerm
from physic_paper.terms.reprojection import ReprojectionByAxisTerm, confident_keypoints
from physic_paper.unwhitened_state import build_unwhitened_state

__all__ = ["ProxContactSettings", "ProxOptimisation", "ProxPriorSettings", "ProxReprojectionSettings"]

_FULL_HD_PX = 1920  # long side of PROX's images, which define the scale of its robust reprojection loss
_REPROJECTION_SCALE_PX = 100.0
_SEARCH_RADIUS_M = 0.5  # search radius of contact and penetration
_CONTACT_SCALE_M = 0.05  # scale of the robust loss of contact
_CONTACT_ANGLE_DEG = 45.0
_VERTICES_PER_DM2 = 60.0  # vertices per square decimetre of the mesh that PROX sums over
_POSE_WEIGHT = 4.78**2 / 2  # of a squared radian; halved, since a rotation is two columns
_ALONE_SHARE = 0.75  # of the steps, before contact and penetration are added
_FACING_DEG, _MASK_TOLERANCE, _VERTEX_SPACING_M = 70.0, 0.01, 0.02


@dataclass(frozen=True)
class ProxReprojectionSettings:
    """Settings of the reprojection term: errors in pixels of an image with a long side of 1920 px."""

    weight: NotNegative = 1.0
    """Weight of the term; 0 removes it."""


@dataclass(frozen=True)
class ProxContactSettings:
    """Settings of the contact term of static body parts."""

    weight: NotNegative = 1e4 / _CONTACT_SCALE_M**2
    """Weight of the mean robust distance, which saturates at the square of its scale (in PROX at 1); 0 removes it."""


@dataclass(frozen=True)
class ProxPriorSettings:
    """Settings of the priors of pose and shape."""

    pose_weight: NotNegative = _POSE_WEIGHT
    """Weight of joints and fingers."""
    shape_weight: NotNegative = 25.0
    """Weight of the shape."""


@dataclass(frozen=True)
class ProxOptimisation(JointSettings):
    """Settings of stage 3 as in PROX: constant scene, and no contact and penetration terms in the first steps."""

    frozen: FrozenGroups = ("scale", "offset")
    """Parameter groups that are kept constant: root, pose, hands, betas, translation, scale."""
    optimiser: LbfgsSettings = field(default_factory=lambda: LbfgsSettings(120, 30, 0.0))
    """L-BFGS."""
    reprojection: ProxReprojectionSettings = field(default_factory=ProxReprojectionSettings)
    """Keypoints."""
    contact: ProxContactSettings = field(default_factory=ProxContactSettings)
    """Contact with the scene."""
    penetration: PointPenetrationSettings = field(
        default_factory=lambda: PointPenetrationSettings(_VERTICES_PER_DM2, _SEARCH_RADIUS_M)
    )
    """Vertices inside the scene."""
    prior: ProxPriorSettings = field(default_factory=ProxPriorSettings)
    """Prior of the parameters."""
    limits: LimitSettings = field(default_factory=LimitSettings)
    """Knees and elbows."""

    nearest_every_step: ClassVar[bool] = True

    @property
    def energy_options(self) -> EnergyOptions:
        """Options of the energy: static contacts."""
        return EnergyOptions(
            search_radius_m=max(_SEARCH_RADIUS_M, self.penetration.max_depth_m),
            facing_deg=_FACING_DEG,
            mask_tolerance=_MASK_TOLERANCE,
            vertex_spacing_m=_VERTEX_SPACING_M,
            static_contacts=True,
        )

    def prepare(self, problem: JointProblem) -> JointProblem:
        """Return the problem with all limbs visible and without a floor."""
        return replace(problem, observed=torch.ones_like(problem.observed), floor_normal=None)

    def weigh_keypoints(self, problem: JointProblem, person_px: Tensor) -> Keypoints:
        """Return the keypoints, weighted by squared confidence."""
        return confident_keypoints(problem, power=2.0)

    def initial_state(self, context: JointContext) -> State:
        """Return raw parameters: two columns of each rotation, translation and shape."""
        return build_unwhitened_state(context, self.frozen)

    def terms(self, context: JointContext, state: State) -> Sequence[Term]:
        """Return the terms of PROX without self-penetration and bending prior."""
        unit = max(context.problem.masks.shape[-2:]) / _FULL_HD_PX
        others = dict.fromkeys(("root", "translation", "offset"), 0.0)
        p = self.prior
        return [
            ReprojectionByAxisTerm(
                context,
                self.reprojection.weight,
                unit,
                partial(robust_loss, "geman_mcclure", c=_REPROJECTION_SCALE_PX),
            ),
            PointContactTerm(
                context,
                self.contact.weight,
                _SEARCH_RADIUS_M,
                partial(robust_loss, "geman_mcclure", c=_CONTACT_SCALE_M),
                mean=True,
                max_angle_deg=_CONTACT_ANGLE_DEG,
            ),
            PointPenetrationTerm(
                self.penetration,
                context,
                partial(robust_loss, "absolute", c=1.0),
                lambda snapshot: snapshot.visibility.eligible,
            ),
            ParameterPriorTerm(
                state, {"pose": p.pose_weight, "hands": p.pose_weight, "betas": p.shape_weight, **others}
            ),
            LimitTerm(self.limits),
        ]

    def minimise(self, energy: JointEnergy, progress: Progress | None = None) -> MinimisationResult:
        """Minimise the energy from its present state, in place, at first without contact and penetration."""
        alone = round(_ALONE_SHARE * self.optimiser.steps)
        if not alone:
            return super().minimise(energy, progress)
        origin, terms = energy.state.pack(), energy.terms
        energy.terms = tuple(t for t in terms if not isinstance(t, PointContactTerm | PointPenetrationTerm))
        first = replace(self.optimiser, steps=alone).minimise(
            energy, None if progress is None else lambda share: progress(_ALONE_SHARE * share)
        )
        energy.terms = terms
        energy.refresh()
        second = replace(self.optimiser, steps=self.optimiser.steps - alone).minimise(
            energy, None if progress is None else lambda share: progress(_ALONE_SHARE + (1 - _ALONE_SHARE) * share)
        )
        final = energy.state.pack()
        energy.state.load(origin)
        with torch.no_grad():
            start = term_totals(energy())
        energy.state.load(final)
        evaluations, steps = first.evaluations + second.evaluations, first.steps + second.steps
        return replace(second, start=start, evaluations=evaluations, steps=steps)
