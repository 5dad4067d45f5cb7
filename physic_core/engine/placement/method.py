"""The steps of stage 2. An energy may override some of them in a subclass.

The default minimises for each person, by Gauss-Newton steps with nearest points updated at each
step,

    lambda_j2d mean_j rho(|pi(J_j + t) - u_j|^2 / size^2)
    + lambda_d (mean_v min_p rho(|v + t - e^g p|^2) + mean_p min_v rho(|e^g p - v - t|^2))
    + floor_weight rho(h(t)^2) + offset cost (g / sigma)^2

over the translation t and the depth offset g. g is free if the person's feet are visible and there
is a floor. Monocular depth places people farther away than the floor under their feet, so without g
the body leaves the floor. Means and relative sizes make all terms independent of the resolution.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

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
    term_energy,
)
from physic_core.geometry.alignment import AlignmentOptions
from physic_core.geometry.camera import project
from physic_core.geometry.mesh import vertex_normals
from physic_core.geometry.pointmap import depth_edges, edge_ratio, isolated_pixels
from physic_core.geometry.tensors import dilate_square, quantiles
from physic_core.geometry.visibility import facing_camera, inside_mask
from physic_core.types import Skeleton
from physic_core.types.bounds import NotNegative, PointCount, PositiveOrInfinite, Share

POINTMAP_TOLERANCE = 0.15
"""Largest difference of the two point maps at an inlier, as a share of the depth.

Below 0.1, the fit may follow only one surface.
"""

FEWEST_POINTS = 50
"""Minimum number of human points and of camera-facing vertices for Eq. 4."""

_MASK_GROWTH = 0.01  # of the long image side: networks blur depth at the silhouette
# standard deviation of the background weight, as a share of the inverse depth range
_DEPTH_SHARE = 0.15
_QUANTILE_PIXELS = 20_000
_FAR_WEIGHT = 0.05  # weight of background far from the people's depth
_FACING_DEG = 70.0  # between a vertex's normal and the direction to the camera
_OFFSET_COST_M = 0.05  # distance that costs as much as a depth offset of one sigma
_ROUNDS = 2  # selections of camera-facing vertices
_MOVED_M = 1e-3


@dataclass(frozen=True)
class Fit:
    """Translation and log depth offset by Eq. 3-4.

    Attributes:
        x: (4,).
        seen: (V,) bool, the camera-facing vertices of Eq. 4.
        chamfer_m: median distance before and after; None with too few points or vertices.
    """

    x: Tensor
    seen: Tensor
    chamfer_m: tuple[float, float] | None = None

    @property
    def pairs(self) -> Tensor | None:
        """``seen``, or None if Eq. 4 was not used."""
        return None if self.chamfer_m is None else self.seen


@dataclass(frozen=True)
class PlacementMethod:
    """Stage 2 of preset "default": human points in the scene, and body translation (paper Sec.

    3.2, Eq. 2-4).

    Attributes:
        alignment: options of the alignment of the photo's point map to the scene.
    """

    reprojection_weight: NotNegative = 1000.0
    """Lambda_j2d of Eq. 3."""
    chamfer_weight: NotNegative = 0.6
    """Lambda_d of Eq. 3; 0 stops after Eq. 2."""
    min_confidence: Share = 0.3
    """Keypoints of lower confidence are ignored."""
    robust_px_share: PositiveOrInfinite = 0.05
    """Scale of the robust reprojection error, as a share of the person's size in the image; "inf"
    is least squares.
    """
    robust_m: PositiveOrInfinite = 0.15
    """Minimum scale of the robust Chamfer distance, metres; "inf" is least squares."""
    max_points: PointCount = 1000
    """Maximum number of a person's points, and of camera-facing vertices, in Eq.

    4; its run time is proportional to it.
    """
    depth_offset_sigma: NotNegative = 0.2
    """Prior of log(depth offset) of a person with visible feet on a known floor; 0 fixes the human
    points to the scene.
    """
    floor_weight: NotNegative = 1.0
    """Weight of the distance of the lower foot to the floor, for visible feet on a known floor; 0
    disables it.
    """
    stance: bool = True
    """Whether feet are pulled to the floor in proportion to the probability that they touch
    something (:mod:`physic_core.engine.stance`), and feet of people in the air not at all.
    """

    alignment: ClassVar[AlignmentOptions] = AlignmentOptions(POINTMAP_TOLERANCE)

    def grow_mask(self, people: Tensor) -> Tensor:
        """Return the pixels (H, W) bool that are not background, from the mask of all people."""
        return dilate_square(people, round(_MASK_GROWTH * max(people.shape)))

    def weigh_background(
        self, depth: Tensor, valid: Tensor, people: Tensor, background: Tensor
    ) -> Tensor | None:
        """Return the weight (H, W) of background pixels in the alignment, from the depth (H, W);
        None means uniform.

        It is by the difference of inverse depth to people. Two point maps of one scene differ by
        more than an affine map. Without weights, sky and far walls would dominate the alignment,
        and the ground at the feet would be wrong.
        """
        inverse = torch.where(valid & (depth > 0), 1 / depth, 0.0)
        own = inverse[people & (inverse > 0)]
        others = inverse[background & (inverse > 0)]
        if not len(own) or not len(others):
            return None
        low, high = quantiles(own, (0.1, 0.9), _QUANTILE_PIXELS)
        nearest, farthest = quantiles(torch.cat((own, others)), (0.01, 0.99), _QUANTILE_PIXELS)
        extent = farthest - nearest
        if not extent > 0:
            return None
        gap = torch.maximum(low - inverse, inverse - high).clamp(min=0) / (_DEPTH_SHARE * extent)
        return _FAR_WEIGHT + (1 - _FAR_WEIGHT) * torch.exp(-0.5 * gap.square())

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
        # Depth edges need pixels outside the mask, as networks mix person and background at its
        # rim.
        own = known & inside & ~depth_edges(cloud[..., 2], known, ratio)
        return _subsample(cloud[own & ~isolated_pixels(cloud[..., 2], own, ratio)], self.max_points)

    def normals(self, vertices: Tensor, faces: Tensor) -> Tensor:
        """Return the normals (B, V, 3) of the estimated bodies."""
        return vertex_normals(vertices, faces)

    def keypoint_columns(self, skeleton: Skeleton) -> list[int]:
        """Return the indices of the keypoints that are used."""
        return placement_keypoints(skeleton)

    def weigh_keypoints(
        self, skeleton: Skeleton, keypoints: Tensor, confidence: Tensor, masks: Tensor
    ) -> Tensor:
        """Return the weight (B, J) of keypoints (B, J, 2), px, for people with masks (B, H, W)."""
        return confidence

    def mask(self, masks: Tensor, person: int) -> Tensor:
        """Return the pixels (H, W) bool in which a person's vertices count as visible, from all
        masks (B, H, W).
        """
        own: Tensor = masks[person]
        return own

    def error_unit(self, keypoints: Tensor, mask: Tensor) -> Tensor:
        """Return the size (2,) in px that reprojection errors are divided by: the diagonal of the
        person's box.
        """
        corners = keypoints
        if bool(mask.any()):
            rows = mask.any(1).nonzero()[:, 0]
            columns = mask.any(0).nonzero()[:, 0]
            ends = [[int(columns[0]), int(rows[0])], [int(columns[-1]), int(rows[-1])]]
            corners = torch.cat((corners, torch.tensor(ends, dtype=torch.float64)))
        if not len(corners):
            return torch.ones(2, dtype=torch.float64)
        diagonal: Tensor = torch.linalg.vector_norm(corners.amax(0) - corners.amin(0)).clamp(
            min=1.0
        )
        return diagonal.expand(2)

    def facing(self, person: PlacementProblem, moved: Tensor) -> Tensor:
        """Return which vertices (V, 3), after translation, face the camera: (V,) bool."""
        return facing_camera(person.normals, moved, _FACING_DEG)

    def camera_facing(self, person: PlacementProblem, x: Tensor) -> Tensor:
        """Return vertices V_cf of Eq. 4, which face the camera and project into the person's mask:
        (V,) bool.
        """
        moved = person.vertices + x[:-1]
        seen = self.facing(person, moved) & (moved[:, 2] > NEAREST_M)
        return seen & person.outer & inside_mask(project(moved, person.K), person.mask)

    def reprojection_term(self, person: PlacementProblem) -> PlacementReprojectionTerm:
        """Return the term of Eq. 2, times lambda_j2d."""
        weight = self.reprojection_weight * person.confidence / person.confidence.sum()
        return PlacementReprojectionTerm(person, weight, self.robust_px_share)

    def chamfer_term(self, person: PlacementProblem, seen: Tensor) -> ChamferTerm:
        """Return the term of Eq. 4 for the camera-facing vertices ``seen`` (V,) bool, times
        lambda_d.
        """
        vertices = _subsample(person.vertices[seen], self.max_points)
        weight = self.chamfer_weight
        weights = weight / len(vertices), weight / len(person.points)
        return ChamferTerm(vertices, person.points, weights, self.robust_m)

    def floor_term(self, person: PlacementProblem) -> PlacementFloorTerm:
        """Return the term of the floor, with the prior of the depth offset."""
        cost = self.chamfer_weight * (_OFFSET_COST_M / self.depth_offset_sigma) ** 2
        return PlacementFloorTerm(person, self.floor_weight, cost)

    def has_offset(self, person: PlacementProblem) -> bool:
        """Return whether the person's depth offset is free."""
        return person.on_floor and self.depth_offset_sigma > 0

    def fit_keypoints(self, person: PlacementProblem) -> Tensor:
        """Solve Eq. 2: return x (4,)."""
        return gauss_newton(
            [self.reprojection_term(person)], closed_form_translation(person), TRANSLATION
        )

    def fit_points(self, person: PlacementProblem, x: Tensor) -> Fit:
        """Solve Eq. 3-4 from x (4,); camera-facing vertices are selected again after the body has
        moved.
        """
        seen = self.camera_facing(person, x)
        if len(person.points) < FEWEST_POINTS or int(seen.sum()) < FEWEST_POINTS:
            return Fit(x, seen)
        chamfer = self.chamfer_term(person, seen)
        before = chamfer.median(x)
        enough = len(person.keypoints) >= FEWEST_KEYPOINTS
        others: list[PlacementTerm] = [self.reprojection_term(person)] if enough else []
        offset = self.has_offset(person)
        if offset:
            others.insert(0, self.floor_term(person))
        for _ in range(_ROUNDS):
            last = x
            x = gauss_newton([chamfer, *others], x, range(len(x)) if offset else TRANSLATION)
            again = self.camera_facing(person, x)
            if float((x - last).abs().max()) < _MOVED_M or int(again.sum()) < FEWEST_POINTS:
                break
            seen = again
            chamfer = self.chamfer_term(person, again)
        return Fit(x, seen, (before, chamfer.median(x)))

    def finish(self, person: PlacementProblem, fit: Fit) -> Tensor:
        """Return the final x (4,)."""
        return fit.x

    def is_placed(self, person: PlacementProblem) -> bool:
        """Return whether the position of the body is known without the photo."""
        return False

    def losses(self, person: PlacementProblem, fit: Fit) -> dict[str, dict[str, float]]:
        """Return the energy of each used term of Eq. 3 at the estimated ("start") and at the final
        ("end") position.
        """
        terms: dict[str, PlacementTerm] = {}
        if not bool(torch.isfinite(person.vertices).all()):
            return {}
        if len(person.keypoints) >= FEWEST_KEYPOINTS:
            terms["reprojection"] = self.reprojection_term(person)
        if fit.pairs is not None:
            terms["chamfer"] = self.chamfer_term(person, fit.pairs)
            if self.has_offset(person):
                terms["floor"] = self.floor_term(person)
        ends = {"start": torch.zeros_like(fit.x), "end": fit.x}
        return {
            name: {end: term_energy(term, at) for end, at in ends.items()}
            for name, term in terms.items()
        }


def _subsample(points: Tensor, max_points: int) -> Tensor:
    """Return at most ``max_points`` of points (N, 3), evenly spaced by index."""
    last = len(points) - 1
    if last < max_points:
        return points
    return points[
        torch.linspace(0, last, max_points, dtype=torch.float64, device=points.device)
        .round()
        .long()
    ]
