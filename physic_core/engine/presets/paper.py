"""The energy of preset "paper": Eq. 5-7 with the weights as printed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

from physic_core.engine.bounds import NotNegative
from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.conventions import Conventions
from physic_core.engine.joint.settings import AdamSettings, JointSettings
from physic_core.engine.joint.state import State, raw_state
from physic_core.engine.joint.term import Term
from physic_core.engine.joint.terms.chamfer import ChamferSettings, ChamferTerm
from physic_core.engine.joint.terms.point_contact import PointContactSettings, PointContactTerm
from physic_core.engine.joint.terms.point_penetration import PointPenetrationSettings, PointPenetrationTerm
from physic_core.engine.joint.terms.printed_regularisation import (
    PrintedRegularisationSettings,
    PrintedRegularisationTerm,
)
from physic_core.engine.joint.terms.reprojection import ReprojectionTerm, confident_keypoints
from physic_core.engine.joint.terms.scene_scale import SceneScaleTerm
from physic_core.engine.joint.visibility import keep_facing
from physic_core.geometry.robust import robust

__all__ = ["CONTACT_REACH_M", "PaperJoint", "PaperReprojectionSettings", "PaperVisibilitySettings"]

CONTACT_REACH_M = 0.15
"""eps of L_c, metres: not printed, as released."""

_MIN_CONFIDENCE = 0.5  # as released
_FACING_DEG = 70.0
_barron = partial(robust, "barron", c=1.0)
_square = partial(robust, "square", c=1.0)


@dataclass(frozen=True)
class PaperReprojectionSettings:
    """Reprojection, in shares of the image.

    Attributes:
        weight: lambda_j2d of Eq. 5; 0 removes the term.
    """

    weight: NotNegative = 10_000.0


@dataclass(frozen=True)
class PaperVisibilitySettings:
    """Which vertices the photo shows.

    Attributes:
        occlusion_aware: hidden vertices are left out of penetration and regularised more.
    """

    occlusion_aware: bool = True


@dataclass(frozen=True)
class PaperJoint(JointSettings):
    """Stage 3 as printed: raw parameters, Adam, distances to the nearest points, every vertex counted once.

    Attributes:
        frozen: groups that stay as they are: root, pose, hands, betas, translation, scale.
        optimiser: Adam.
        visibility: which vertices the photo shows.
        reprojection: keypoints.
        depth: human points.
        contact: contact with the scene.
        penetration: vertices inside the scene.
        regularisation: deviation from the start.
    """

    optimiser: AdamSettings = field(default_factory=AdamSettings)
    visibility: PaperVisibilitySettings = field(default_factory=PaperVisibilitySettings)
    reprojection: PaperReprojectionSettings = field(default_factory=PaperReprojectionSettings)
    depth: ChamferSettings = field(default_factory=ChamferSettings)
    contact: PointContactSettings = field(default_factory=PointContactSettings)
    penetration: PointPenetrationSettings = field(default_factory=PointPenetrationSettings)
    regularisation: PrintedRegularisationSettings = field(default_factory=PrintedRegularisationSettings)

    @property
    def conventions(self) -> Conventions:
        """All limbs count as seen, and samples of the floor are scene points."""
        return Conventions(
            weigh_keypoints=partial(confident_keypoints, min_confidence=_MIN_CONFIDENCE),
            update_visibility=keep_facing,
            search_radius_m=max(CONTACT_REACH_M, self.penetration.max_depth_m),
            facing_deg=_FACING_DEG,
            mask_tolerance=0.0,
            vertex_spacing_m=0.0,
            count_vertices=True,
            observed_limbs_only=False,
            static_contacts=self.contact.source == "static",
            floor="points",
            nearest="grid",
            nearest_every_step=True,
        )

    def initial_state(self, context: JointContext) -> State:
        """Rotations as their first two columns, translation, shape and scale."""
        return raw_state(context, self.frozen)

    def terms(self, context: JointContext, state: State) -> Sequence[Term]:
        """Eq. 5 as printed."""
        aware = self.visibility.occlusion_aware
        height, width = context.problem.masks.shape[-2:]
        size = context.person_px.new_tensor([[width, height]]).expand(len(context.problem), 2)
        return [
            ReprojectionTerm(context, self.reprojection.weight, size, _square),
            ChamferTerm(self.depth, context),
            PointContactTerm(context, self.contact.weight, CONTACT_REACH_M, _barron),
            PointPenetrationTerm(
                self.penetration,
                context,
                _barron,
                lambda view: view.visibility.in_play & ~(view.visibility.hidden & aware),
            ),
            PrintedRegularisationTerm(self.regularisation, context, occlusion_aware=aware),
            SceneScaleTerm(self.regularisation.weight),
        ]
