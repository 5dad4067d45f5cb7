"""Preset "release": the joint energy of the released code.

Measured on a problem of the released code (one person, 2570 vertices): terms agree within 2e-5,
gradients within 5e-5 of the largest entry, stage 1 within 1 um; outliers, grid and contact map
agree exactly; stage 3 ends 2.0 mm from the released result. Deviations, with their effect on that
problem where it was measured:

- Stage 2 uses a line search. It ends 2 um from the minimum of the released objective. Without it
  the released code ends 100 mm from the minimum, and 5.5 mm from its own result when it is run
  again.
- Limbs are hidden if less than 0.7 of their vertices are visible. Grazing rays change this share by
  up to 0.05 when vertices move by 1 um, in the released code too. At the first update one limb of
  twelve is visible here and hidden there.
- Bodies have 69 of the 133 keypoints, each weighted as in the released code: stage 1 differs by 9.6
  mm with them, stage 2 by 2.9 mm. The root of a hand is excluded from the mean confidence by which
  a hand is rejected.
- The floor is searched with 200 hypotheses of three points each: .01 mm. Of 455 points that are
  dropped by their normals 8 differ, by ties among their neighbours.
- A vertex outside the box of the grid is searched exactly. The released code then searches all
  vertices exactly (there was no such vertex).
- The scene is not enlarged before stage 2 (factor 1 there), and fx and fy are not averaged (equal
  there).
- After stage 3 people return to their start if their own energy is lower there, and Adam is
  repeated with a tenth of the learning rate. Not measured.
- Vertices inside eyes and mouth are skipped. Not measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

from torch import Tensor

from physic_core.body import BodyOutput
from physic_core.engine.joint import (
    OcclusionTracker,
    Sampling,
    SceneScaleTerm,
    Snapshot,
    Term,
    Variables,
    Visibility,
    VisibilitySettings,
)
from physic_core.engine.state import State
from physic_core.geometry import robust_loss
from physic_paper.paper import (
    CONTACT_RANGE_M,
    PaperJointStage,
    PaperReprojectionSettings,
)
from physic_paper.released.regularisation import ReleasedRegularisationTerm
from physic_paper.released.reprojection import ReleasedReprojectionTerm, released_weights
from physic_paper.released.visibility import update_released_visibility
from physic_paper.terms.chamfer import ChamferDepthTerm, human_points_of
from physic_paper.terms.point_contact import PointContactTerm
from physic_paper.terms.point_penetration import PointPenetrationSettings, PointPenetrationTerm
from physic_paper.terms.printed_regularisation import PrintedRegularisationSettings

_FACING_DEG = 80.0
_barron = partial(robust_loss, "barron", c=1.0)


@dataclass(frozen=True)
class ReleaseReprojectionSettings(PaperReprojectionSettings):
    """Settings of the reprojection term: absolute errors in shares of the image."""

    reduction: Literal["mean"] = "mean"
    """Always the "mean" over 133 keypoints."""


@dataclass(frozen=True)
class ReleaseJointStage(PaperJointStage):
    """Settings of stage 3 as released: robust loss per axis, absolute reprojection errors, union of
    all masks.
    """

    visibility: VisibilitySettings = VisibilitySettings(
        vertex_spacing_m=0.0, facing_deg=_FACING_DEG, mask_tolerance=0.0
    )
    """Visibility of vertices."""
    reprojection: ReleaseReprojectionSettings = ReleaseReprojectionSettings()
    """Keypoints."""
    penetration: PointPenetrationSettings = PointPenetrationSettings(max_depth_m=0.15)
    """Vertices inside the scene."""
    regularisation: PrintedRegularisationSettings = PrintedRegularisationSettings(
        visible_weight=0.0
    )
    """Deviation from the start."""

    def prepare(self, state: State) -> State:
        """Return the state with all limbs visible, and the union of all masks for each person."""
        masks = state.masks.any(0, keepdim=True).expand_as(state.masks)
        return replace(super().prepare(state), masks=masks, human_points=human_points_of(state))

    def weigh_keypoints(self, state: State) -> Tensor:
        """Return the keypoint weights of the released code."""
        return released_weights(state)

    def update_visibility(
        self,
        sampling: Sampling,
        bodies: BodyOutput,
        self_occlusion: OcclusionTracker,
        last: Visibility | None,
    ) -> Visibility:
        """Return the visibility of the posed bodies, computed as in the released code."""
        return update_released_visibility(sampling, bodies, self_occlusion, last)

    def terms(self, sampling: Sampling, variables: Variables) -> Sequence[Term]:
        """Return the terms of Eq. 5 as released."""
        aware = self.visibility.occlusion_aware

        def may_not_penetrate(snapshot: Snapshot) -> Tensor:
            visibility = snapshot.visibility
            return visibility.eligible & (visibility.in_mask | (not aware)) & ~sampling.is_contact

        return [
            ReleasedReprojectionTerm(sampling, self.reprojection.weight),
            ChamferDepthTerm(self.depth.weight, sampling),
            PointContactTerm(
                sampling,
                self.contact.weight,
                CONTACT_RANGE_M,
                _barron,
                per_axis=True,
                outside_only=True,
            ),
            PointPenetrationTerm(
                self.penetration, sampling, _barron, may_not_penetrate, per_axis=True
            ),
            ReleasedRegularisationTerm(self.regularisation, sampling, variables),
            SceneScaleTerm(self.regularisation.weight),
        ]
