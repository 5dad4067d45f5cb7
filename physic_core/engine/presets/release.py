"""The energy of preset "release": that of the published code."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from torch import Tensor

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.conventions import Conventions
from physic_core.engine.joint.released.regularisation import ReleasedRegularisationTerm
from physic_core.engine.joint.released.reprojection import ReleasedReprojectionTerm, released_keypoints
from physic_core.engine.joint.released.visibility import update_released_visibility
from physic_core.engine.joint.state import State
from physic_core.engine.joint.term import Term, View
from physic_core.engine.joint.terms.chamfer import ChamferTerm
from physic_core.engine.joint.terms.point_contact import PointContactTerm
from physic_core.engine.joint.terms.point_penetration import PointPenetrationSettings, PointPenetrationTerm
from physic_core.engine.joint.terms.printed_regularisation import PrintedRegularisationSettings
from physic_core.engine.joint.terms.scene_scale import SceneScaleTerm
from physic_core.engine.presets.paper import CONTACT_REACH_M, PaperJoint
from physic_core.geometry.robust import robust

__all__ = ["ReleasedJoint"]

_FACING_DEG = 80.0
_barron = partial(robust, "barron", c=1.0)


@dataclass(frozen=True)
class ReleasedJoint(PaperJoint):
    """Stage 3 as published: distances by axis, absolute reprojection errors, and all masks as one.

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

    penetration: PointPenetrationSettings = field(default_factory=lambda: PointPenetrationSettings(max_depth_m=0.15))
    regularisation: PrintedRegularisationSettings = field(
        default_factory=lambda: PrintedRegularisationSettings(visible_weight=0.0)
    )

    @property
    def conventions(self) -> Conventions:
        """As printed, with the masks, normals and hidden limbs of the published code."""
        return replace(
            super().conventions,
            weigh_keypoints=released_keypoints,
            update_visibility=update_released_visibility,
            facing_deg=_FACING_DEG,
            merge_masks=True,
        )

    def terms(self, context: JointContext, state: State) -> Sequence[Term]:
        """Eq. 5 as published."""
        aware = self.visibility.occlusion_aware

        def may_not_penetrate(view: View) -> Tensor:
            seen = view.visibility
            return seen.in_play & (seen.in_mask | (not aware)) & ~context.is_contact

        return [
            ReleasedReprojectionTerm(context, self.reprojection.weight),
            ChamferTerm(self.depth, context),
            PointContactTerm(context, self.contact.weight, CONTACT_REACH_M, _barron, per_axis=True, outside_only=True),
            PointPenetrationTerm(self.penetration, context, _barron, may_not_penetrate, per_axis=True),
            ReleasedRegularisationTerm(self.regularisation, context, state, occlusion_aware=aware),
            SceneScaleTerm(self.regularisation.weight),
        ]
