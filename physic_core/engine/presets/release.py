"""Preset "release": the joint energy of the published code.

Measured on a problem of the released code (one person, 2570 vertices): terms agree within 2e-5, gradients within 5e-5
of the largest entry, stage 1 within 1 um; outliers, grid and contact map agree exactly; stage 3 ends 2.0 mm from the
released result. Deviations, with their effect on that problem where it was measured:

- Stage 2 uses a line search. It ends 2 um from the minimum of the released objective. Without it the released code ends
  100 mm from the minimum, and 5.5 mm from its own result when it is run again.
- Limbs are hidden if less than 0.7 of their vertices are visible. Grazing rays change this share by up to 0.05 when
  vertices move by 1 um, in the released code too. At the first update one limb of twelve is visible here
  and hidden there.
- Bodies have 69 of the 133 keypoints, each weighted as in the released code: stage 1 differs by 9.6 mm with them,
  stage 2 by 2.9 mm. The root of a hand is left out of the mean confidence by which a hand is rejected.
- The floor is searched with 200 hypotheses of three points each: .01 mm. Of 455 points that are dropped by their
  normals 8 differ, by ties among their neighbours.
- A vertex outside the box of the grid is searched exactly. The released code then searches all vertices exactly (there
  was no such vertex).
- The scene is not enlarged before stage 2 (factor 1 there), and fx and fy are not averaged (equal there).
- After stage 3 people return to their start if their own energy is lower there. Not measured.
- Vertices inside eyes and mouth are left out. Not measured.
"""

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
        frozen: parameter groups that are kept constant: root, pose, hands, betas, translation, scale.
        optimiser: Adam.
        visibility: of vertices.
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
