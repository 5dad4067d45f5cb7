"""Preset "prox": the joint energy of PROX (Hassan et al., ICCV 2019), the baseline of the paper.

Deviations from the publication:

- The scene is an unprojected depth map, as in the paper's comparison.
- The pose prior is the distance to the estimated pose, instead of VPoser.
- The seven phases are two: without and with the scene.
- The exponential bending prior is a one-sided limit.
- Nearest scene points are searched within half a metre, and the body's vertices are subsampled.
- Self-penetration, jaw and expression are not modelled.
- Neck and hip keypoints, which PROX ignores, count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from torch import Tensor

from physic_core.engine.joint import (
    LbfgsOptimiser,
    LimitTerm,
    Optimiser,
    Sampling,
    Term,
    TermWeight,
    Variables,
    with_static_contacts,
)
from physic_core.engine.state import State
from physic_core.geometry import robust_loss
from physic_core.types import FrozenGroups
from physic_paper.published import PublishedJointStage
from physic_paper.terms.point_contact import PointContactTerm
from physic_paper.terms.point_penetration import PointPenetrationSettings, PointPenetrationTerm
from physic_paper.terms.printed_regularisation import ParameterPriorTerm
from physic_paper.terms.reprojection import ReprojectionByAxisTerm, confidence_weights

_FULL_HD_PX = 1920  # long side of PROX's images, which define its robust reprojection loss
_REPROJECTION_SCALE_PX = 100.0
_SEARCH_RADIUS_M = 0.5  # search radius of contact and penetration
_CONTACT_SCALE_M = 0.05  # scale of the robust loss of contact
_CONTACT_ANGLE_DEG = 45.0
_VERTICES_PER_DM2 = 60.0  # vertices per square decimetre of the mesh that PROX sums over
_POSE_WEIGHT = 4.78**2 / 2  # of a squared radian; halved, since a rotation is two columns
_PRIOR_WEIGHTS = {
    "pose": _POSE_WEIGHT,
    "hands": _POSE_WEIGHT,
    "betas": 25.0,
    "root": 0.0,
    "translation": 0.0,
    "offset": 0.0,
}


@dataclass(frozen=True)
class ProxJointStage(PublishedJointStage):
    """Settings of stage 3 as in PROX: constant scene, and no contact and penetration terms in the
    first steps.
    """

    samples_floor = False

    frozen: FrozenGroups = ("scale", "offset")
    """Parameter groups that are kept constant: root, pose, hands, betas, translation, scale."""
    optimiser: LbfgsOptimiser = LbfgsOptimiser(90, 30, 0.0)
    """L-BFGS. A third as many steps follow, with contact and penetration."""
    reprojection: TermWeight = TermWeight(1.0)
    """Keypoints: errors in pixels of an image with a long side of 1920 px."""
    contact: TermWeight = TermWeight(1e4 / _CONTACT_SCALE_M**2)
    """Mean robust distance of static body parts from the scene, which saturates at the square of
    its scale (in PROX at 1).
    """
    penetration: PointPenetrationSettings = PointPenetrationSettings(
        _VERTICES_PER_DM2, _SEARCH_RADIUS_M
    )
    """Vertices inside the scene."""
    limits: TermWeight = TermWeight(1.0)
    """Knees and elbows."""

    @property
    def search_radius_m(self) -> float:
        """Search radius of vertices for scene points, metres."""
        return max(_SEARCH_RADIUS_M, self.penetration.max_depth_m)

    def prepare(self, state: State) -> State:
        """Return the state with all limbs visible, and with static contacts."""
        return with_static_contacts(super().prepare(state))

    def weigh_keypoints(self, state: State) -> Tensor:
        """Return weights by squared confidence."""
        return confidence_weights(state, power=2.0)

    def terms(self, sampling: Sampling, variables: Variables) -> Sequence[Term]:
        """Return the terms of the first steps, without bending prior: see :meth:`late_terms`."""
        unit = max(sampling.state.masks.shape[-2:]) / _FULL_HD_PX
        return [
            ReprojectionByAxisTerm(
                sampling,
                self.reprojection.weight,
                unit,
                partial(robust_loss, "geman_mcclure", c=_REPROJECTION_SCALE_PX),
            ),
            ParameterPriorTerm(variables, _PRIOR_WEIGHTS),
            LimitTerm(self.limits.weight),
        ]

    def late_terms(self, sampling: Sampling) -> tuple[Sequence[Term], Optimiser, Optimiser]:
        """Return contact and penetration, for a third as many steps as without them."""
        contact = PointContactTerm(
            sampling,
            self.contact.weight,
            _SEARCH_RADIUS_M,
            partial(robust_loss, "geman_mcclure", c=_CONTACT_SCALE_M),
            takes_mean=True,
            max_angle_deg=_CONTACT_ANGLE_DEG,
        )
        penetration = PointPenetrationTerm(
            self.penetration,
            sampling,
            partial(robust_loss, "absolute", c=1.0),
            lambda snapshot: snapshot.visibility.eligible,
        )
        late = replace(self.optimiser, steps=self.optimiser.steps // 3)
        return [contact, penetration], self.optimiser, late
