"""The steps of stage 2. An energy may override some of them in a subclass.

The default minimises for each person, by Gauss-Newton steps with new nearest points at each step,

    lambda_j2d mean_j rho(|pi(J_j + t) - u_j|^2 / size^2)
    + lambda_d (mean_v min_p rho(|v + t - e^g p|^2) + mean_p min_v rho(|e^g p - v - t|^2))
    + floor_weight rho(h(t)^2) + offset cost (g / sigma)^2

over x = (t, g), a translation and the logarithm of a depth offset. g is free if the person's feet
are visible and there is a floor. Monocular depth places people farther away than the floor under
their feet, so without g the body leaves the floor. Means and relative sizes make all terms
independent of the resolution. Float64 on the CPU, which is fastest for k-d trees of a few thousand
points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar

import torch
from torch import Tensor

from physic_core.engine.limbs import placement_keypoints
from physic_core.engine.placement.terms import (
    FEWEST_KEYPOINTS,
    NEAREST_M,
    TRANSLATION,
    ChamferTerm,
    PlacementFloorTerm,
    PlacementProblem,
    PlacementReprojectionTerm,
    PlacementTerm,
    closed_form_translation,
    gauss_newton,
)
from physic_core.geometry.alignment import AlignmentOptions
from physic_core.geometry.camera import project
from physic_core.geometry.mesh import vertex_normals
from physic_core.geometry.pointmap import depth_edges, edge_ratio, isolated_pixels
from physic_core.geometry.visibility import FACING_DEG, facing_camera, inside_mask
from physic_core.types.bounds import NotNegative, PointCount, PositiveOrInfinite, Share
from physic_core.types.skeletons import SEEN_CONFIDENCE

if TYPE_CHECKING:
    from physic_core.engine.state import State

POINTMAP_TOLERANCE = 0.15
"""Largest difference of the two point maps at an inlier, as a share of the depth. Below 0.1, the
fit may follow only one surface."""

FEWEST_POINTS = 50
"""Minimum number of human points and of camera-facing vertices for Eq. 4."""

_FARTHEST = 1e3  # largest distance of a placed body, over the estimated distance
_OFFSET_COST_M = 0.05  # distance that costs as much as a depth offset of one sigma
_ROUNDS = 2  # selections of camera-facing vertices
_MOVED_M = 1e-3


def _unmoved() -> Tensor:
    return torch.zeros(4, dtype=torch.float64)


@dataclass(frozen=True)
class Fit:
    """Move of one person by Eq. 2-4.

    Attributes:
        x: (4,) translation in metres and log depth offset.
        facing: (V,) bool, the camera-facing vertices of Eq. 4; None if Eq. 4 was not used.
        by_keypoints: (4,) the move by Eq. 2 alone.
        problem: why keypoints, depth and floor did not place the person, or "".
    """

    x: Tensor = field(default_factory=_unmoved)
    facing: Tensor | None = None
    by_keypoints: Tensor = field(default_factory=_unmoved)
    problem: str = ""


@dataclass(frozen=True)
class PlacementStageMethod:
    """Stage 2 of preset "default": points of people in the scene, and body translation (paper
    Sec. 3.2, Eq. 2-4).

    Attributes:
        alignment: options of the alignment of the photo's point map to the scene.
        mask_growth: width of the rim around people without background, as a share of the long
            image side: networks blur depth at the silhouette.
        weighs_background: whether background at the depth of people counts more.
        uses_sums: whether Eq. 2-4 are sums over all keypoints, vertices and points, with keypoint
            errors as shares of the photo's size, as printed.
    """

    reprojection_weight: NotNegative = 1000.0
    """Lambda_j2d of Eq. 3."""
    chamfer_weight: NotNegative = 0.6
    """Lambda_d of Eq. 3; 0 stops after Eq. 2."""
    min_confidence: Share = SEEN_CONFIDENCE
    """Keypoints of lower confidence are ignored."""
    robust_px_share: PositiveOrInfinite = 0.05
    """Scale of the robust reprojection error, as a share of the person's size in the image; "inf"
    is least squares."""
    robust_m: PositiveOrInfinite = 0.15
    """Minimum scale of the robust Chamfer distance, metres; "inf" is least squares."""
    max_points: PointCount = 1000
    """Maximum number of a person's points, and of camera-facing vertices, in Eq. 4; its run time is
    proportional to it."""
    depth_offset_sigma: NotNegative = 0.2
    """Prior of log(depth offset) of a person with visible feet on a known floor; 0 fixes the human
    points to the scene."""
    floor_weight: NotNegative = 1.0
    """Weight of the distance of the lower foot to the floor, for visible feet on a known floor; 0
    disables it."""
    stance: bool = True
    """Whether feet are pulled to the floor in proportion to the probability that they touch
    something (:mod:`physic_core.engine.ground.stance`), and feet of people in the air not at all.
    """

    alignment: ClassVar[AlignmentOptions] = AlignmentOptions(POINTMAP_TOLERANCE)
    mask_growth: ClassVar[float] = 0.01
    weighs_background: ClassVar[bool] = True
    uses_sums: ClassVar[bool] = False

    def clean_points(
        self, cloud: Tensor, known: Tensor, inside: Tensor, size: tuple[int, ...]
    ) -> Tensor:
        """Return the points (M, 3) of one person.

        Args:
            cloud: (h, w, 3) crop of the photo's point map, metres; 0 where unknown.
            known: (h, w) bool.
            inside: (h, w) bool, the person's mask.
            size: (H, W) of the photo.
        """
        ratio = edge_ratio(size[0], size[1])
        # Depth edges need pixels outside the mask: networks mix person and background at its rim.
        own = known & inside & ~depth_edges(cloud[..., 2], known, ratio)
        return _subsample(cloud[own & ~isolated_pixels(cloud[..., 2], own, ratio)], self.max_points)

    def problem_inputs(self, state: State, vertices: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return normals, keypoint weights and masks of the estimated bodies.

        Args:
            state: of N people.
            vertices: (N, V, 3) metres.

        Returns:
            Normals (N, V, 3). Weights (N, J), NaN for keypoints that place no body. Masks (N, H, W)
            bool of pixels in which vertices count as visible.
        """
        weight = torch.full_like(state.keypoint_confidence, math.nan)
        columns = placement_keypoints(state.skeleton)
        weight[:, columns] = state.keypoint_confidence[:, columns]
        return vertex_normals(vertices, state.model.faces), weight, state.masks

    def error_unit(self, keypoints: Tensor, mask: Tensor) -> Tensor:
        """Return the divisor (2,) of reprojection errors, px: the diagonal of the person's box, or
        the size of the photo.
        """
        if self.uses_sums:
            return torch.tensor(mask.shape[::-1], dtype=torch.float64)
        corners = keypoints
        if mask.any():
            rows = mask.any(1).nonzero()[:, 0]
            columns = mask.any(0).nonzero()[:, 0]
            ends = [[int(columns[0]), int(rows[0])], [int(columns[-1]), int(rows[-1])]]
            corners = torch.cat((corners, torch.tensor(ends, dtype=torch.float64)))
        if not len(corners):
            return torch.ones(2, dtype=torch.float64)
        extent = corners.amax(0) - corners.amin(0)
        diagonal: Tensor = torch.linalg.vector_norm(extent).clamp(min=1.0)
        return diagonal.expand(2)

    def usable_problem(self, person: PlacementProblem) -> PlacementProblem:
        """Return a person with usable keypoints and points alone, and the unit of errors."""
        used = (person.confidence >= self.min_confidence) & torch.isfinite(person.keypoints).all(-1)
        used = used & torch.isfinite(person.landmarks).all(-1)
        return person._replace(
            landmarks=person.landmarks[used],
            keypoints=person.keypoints[used],
            confidence=person.confidence[used],
            size=self.error_unit(person.keypoints[used], person.mask),
            points=person.points[torch.isfinite(person.points).all(-1)],
        )

    def facing(self, person: PlacementProblem, moved: Tensor) -> Tensor:
        """Return which vertices (V, 3), after translation, face the camera: (V,) bool."""
        return facing_camera(person.normals, moved, FACING_DEG)

    def camera_facing(self, person: PlacementProblem, x: Tensor) -> Tensor:
        """Return vertices V_cf of Eq. 4, which face the camera and project into the person's mask:
        (V,) bool.
        """
        moved = person.vertices + x[:-1]
        facing = self.facing(person, moved) & (moved[:, 2] > NEAREST_M)
        return facing & person.outer & inside_mask(project(moved, person.K), person.mask)

    def reprojection_term(self, person: PlacementProblem) -> PlacementReprojectionTerm:
        """Return the term of Eq. 2, times lambda_j2d."""
        weight = self.reprojection_weight * person.confidence
        if not self.uses_sums:
            weight = weight / person.confidence.sum()
        return PlacementReprojectionTerm(person, weight, self.robust_px_share)

    def chamfer_term(self, person: PlacementProblem, seen: Tensor) -> ChamferTerm:
        """Return the term of Eq. 4 for the camera-facing vertices ``seen`` (V,) bool, times
        lambda_d.
        """
        vertices = person.vertices[seen]
        weights = self.chamfer_weight, self.chamfer_weight
        if not self.uses_sums:
            vertices = _subsample(vertices, self.max_points)
            weights = weights[0] / len(vertices), weights[1] / len(person.points)
        return ChamferTerm(vertices, person.points, weights, self.robust_m)

    def floor_term(self, person: PlacementProblem) -> PlacementFloorTerm:
        """Return the term of the floor, with the prior of the depth offset."""
        cost = self.chamfer_weight * (_OFFSET_COST_M / self.depth_offset_sigma) ** 2
        return PlacementFloorTerm(person, self.floor_weight, cost)

    def fit_keypoints(self, person: PlacementProblem) -> Tensor:
        """Solve Eq. 2: return x (4,)."""
        start = closed_form_translation(person)
        return gauss_newton([self.reprojection_term(person)], start, TRANSLATION)

    def fit_to_depth(self, person: PlacementProblem, start: Tensor, facing: Tensor) -> Fit:
        """Solve Eq. 3-4 from ``start`` (4,); the vertices that face the camera, (V,) bool, are
        selected again after the body has moved.
        """
        chamfer = self.chamfer_term(person, facing)
        x = start
        others = list[PlacementTerm]()
        free: Sequence[int] = TRANSLATION
        if person.has_soles_on_floor and self.depth_offset_sigma > 0:
            others.append(self.floor_term(person))
            free = range(len(x))
        if len(person.keypoints) >= FEWEST_KEYPOINTS:
            others.append(self.reprojection_term(person))
        for _ in range(_ROUNDS):
            last = x
            x = gauss_newton([chamfer, *others], x, free)
            new_facing = self.camera_facing(person, x)
            if float((x - last).abs().max()) < _MOVED_M or int(new_facing.sum()) < FEWEST_POINTS:
                break
            facing = new_facing
            chamfer = self.chamfer_term(person, new_facing)
        return Fit(x, facing)

    def finish(self, person: PlacementProblem, fit: Fit) -> Tensor:
        """Return the final x (4,)."""
        return fit.x

    def fit(self, person: PlacementProblem) -> Fit:
        """Place one person; a body that cannot be placed stays where it is."""
        if not torch.isfinite(person.vertices).all():
            lost = "the body has non-finite vertices: its translation was not changed"
            return Fit(problem=lost)
        problem = ""
        by_keypoints = _unmoved()
        if len(person.keypoints) >= FEWEST_KEYPOINTS:
            by_chosen = self.fit_keypoints(person)
            by_keypoints = by_chosen if _is_in_view(person, by_chosen) else by_keypoints
        else:
            problem = (
                f"{len(person.keypoints)} joints are detected with confidence "
                f"{self.min_confidence:g} or more, but {FEWEST_KEYPOINTS} are needed to place a "
                f"body. Do not use this person"
            )
        fit = Fit(by_keypoints)
        if self.chamfer_weight > 0:
            facing = self.camera_facing(person, by_keypoints)
            if min(len(person.points), int(facing.sum())) >= FEWEST_POINTS:
                fit = self.fit_to_depth(person, by_keypoints, facing)
            elif not problem:
                problem = (
                    f"this person has {len(person.points)} points of depth and {int(facing.sum())} "
                    f"visible points of the body, but {FEWEST_POINTS} of each are needed. The "
                    f"distance follows from 2D joints and body size alone, and is doubtful"
                )
        x = self.finish(person, fit)
        if not _is_in_view(person, x):
            lost = "the fit has no translation in front of the camera: the translation was not "
            return Fit(facing=fit.facing, problem=f"{lost}changed")
        return replace(fit, x=x, by_keypoints=by_keypoints, problem=problem)


def _is_in_view(person: PlacementProblem, x: Tensor) -> bool:
    """Return whether x (4,) places a body in front of the camera, and not near infinity.

    With keypoint errors larger than the person, a robust fit can shrink the person to a point.
    """
    depth = float(person.vertices[:, 2].median())
    farthest = _FARTHEST * max(depth, NEAREST_M)
    return bool(torch.isfinite(x).all()) and NEAREST_M <= depth + float(x[2]) <= farthest


def _subsample(points: Tensor, max_points: int) -> Tensor:
    """Return at most ``max_points`` of points (N, 3), evenly spaced by index."""
    last = len(points) - 1
    if last < max_points:
        return points
    rows = torch.linspace(0, last, max_points, dtype=torch.float64)
    return points[rows.round().long()]
