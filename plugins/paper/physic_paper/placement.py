"""Stage 2 of presets "paper", "release" and "prox"."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from physic_core.engine.placement.method import POINTMAP_TOLERANCE, Fit, PlacementStageMethod
from physic_core.engine.placement.terms import (
    FEWEST_KEYPOINTS,
    PlacementProblem,
    term_energy,
)
from physic_core.geometry import project
from physic_core.types import NotNegative, PointCount, PositiveOrInfinite, Share
from physic_paper.outliers import image_outliers
from physic_paper.released.reprojection import released_keypoint_weights, released_reprojection
from physic_paper.released.visibility import is_opposite_optical_axis, mean_face_normals
from physic_paper.scene import released_alignment_options
from physic_paper.translation import restore_keypoint_fit, solve_adam, solve_lbfgs

if TYPE_CHECKING:
    from physic_core.engine.state import State

_RELEASED_FACING_DEG = 80.0


@dataclass(frozen=True)
class PaperPlacement(PlacementStageMethod):
    """Stage 2 as printed: sums of squares of Eq. 2-4, by Adam and L-BFGS.

    The reprojection error is never increased.
    """

    reprojection_weight: NotNegative = 5000.0
    min_confidence: Share = 0.5
    robust_px_share: PositiveOrInfinite = math.inf
    robust_m: PositiveOrInfinite = math.inf
    max_points: PointCount = 3000
    depth_offset_sigma: NotNegative = 0.0
    """Not used."""
    floor_weight: NotNegative = 0.0
    """Not used."""
    stance: bool = False

    alignment = released_alignment_options(POINTMAP_TOLERANCE)
    mask_growth = 0.0
    weighs_background = False
    uses_sums = True

    def clean_points(
        self, cloud: Tensor, known: Tensor, inside: Tensor, size: tuple[int, ...]
    ) -> Tensor:
        """Return all points of the person but outliers by the distance to their neighbours."""
        points = cloud[known & inside]
        return points[~image_outliers(points, size[0], size[1])]

    def reprojection_loss(self, person: PlacementProblem, move: Tensor) -> Tensor:
        """Return the unweighted reprojection loss L_j2d () after a translation (3,), metres."""
        error = (project(person.landmarks + move, person.K) - person.keypoints) / person.size
        return (person.confidence * error.square().sum(-1)).sum()

    def fit_keypoints(self, person: PlacementProblem) -> Tensor:
        """Solve Eq. 2 by Adam."""
        return solve_adam(lambda move: self.reprojection_loss(person, move))

    def fit_to_depth(self, person: PlacementProblem, start: Tensor, facing: Tensor) -> Fit:
        """Solve Eq. 3 by L-BFGS, with the camera-facing vertices at the start."""

        def loss(move: Tensor) -> Tensor:
            return self.reprojection_weight * self.reprojection_loss(person, move)

        enough = len(person.keypoints) >= FEWEST_KEYPOINTS
        chamfer = self.chamfer_term(person, facing)
        return Fit(solve_lbfgs(start, chamfer, loss if enough else None), facing)

    def finish(self, person: PlacementProblem, fit: Fit) -> Tensor:
        """Return x (4,), moved towards the keypoints until their error is no larger than at the
        start.
        """
        if len(person.keypoints) < FEWEST_KEYPOINTS:
            return fit.x
        term = self.reprojection_term(person)

        def errors(at: Tensor) -> tuple[float, float]:
            return term_energy(term, at), person.median_error_px(at)

        largest = errors(torch.zeros_like(fit.x))

        def fits(at: Tensor) -> bool:
            return all(now <= before for now, before in zip(errors(at), largest, strict=True))

        # The total weight of all pairs of Eq. 4. Without points its value has no effect.
        pairs = 1 if fit.facing is None else int(fit.facing.sum()) + len(person.points)
        stiffness = self.chamfer_weight * pairs
        return restore_keypoint_fit(term, fit.x, stiffness, fits)


@dataclass(frozen=True)
class ReleasePlacement(PaperPlacement):
    """Stage 2 as released: its reprojection loss, visibility and camera-facing angle."""

    def problem_inputs(self, state: State, vertices: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return means of the unit normals of adjacent faces, the released keypoint weights, and
        the union of all masks: a person hidden behind another counts as visible.
        """
        masks = state.masks
        weight = released_keypoint_weights(
            state.skeleton, state.keypoints, state.keypoint_confidence, masks
        )
        normals = mean_face_normals(vertices, state.model.faces)
        return normals, weight, masks.any(0).expand_as(masks)

    def facing(self, person: PlacementProblem, moved: Tensor) -> Tensor:
        """Return the vertices whose normal is opposite to the optical axis."""
        return is_opposite_optical_axis(person.normals, _RELEASED_FACING_DEG)

    def reprojection_loss(self, person: PlacementProblem, move: Tensor) -> Tensor:
        """Return the released loss () after a translation (3,), metres."""
        uv = project(person.landmarks + move, person.K)[None]
        detected = person.keypoints[None], person.confidence[None]
        return released_reprojection(uv, *detected, person.size, person.people).sum()

    def finish(self, person: PlacementProblem, fit: Fit) -> Tensor:
        """Return the minimum of Eq. 3."""
        return fit.x
