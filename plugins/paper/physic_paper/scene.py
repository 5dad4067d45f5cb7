"""Stage 1 of presets "paper", "release" and "prox"."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import torch
from torch import Tensor

from physic_core.engine.ground.floor import FloorEvidence
from physic_core.engine.scene.method import (
    METRIC_DEPTH_TOLERANCE,
    Cameras,
    PixelSurface,
    SceneStageMethod,
    scene_camera,
)
from physic_core.geometry import AlignmentOptions, FloorSearch, PlaneFit, pointmap_normals
from physic_core.types import NotNegative, PositiveOrInfinite
from physic_paper.floor_metric import fit_floor_metric
from physic_paper.outliers import KNN_SHARE, image_outliers
from physic_paper.released.pointmap import (
    published_floor_grid,
    published_normal_outliers,
    published_normals,
)

_GRID_SIDE = 100  # floor points along each side, as released


def released_alignment_options(tolerance: float) -> AlignmentOptions:
    """Return the alignment options of the paper (Eq. 1), with the 20 hypotheses of the released
    code.
    """
    return AlignmentOptions(tolerance, hypotheses=20, residual="metric")


@dataclass(frozen=True)
class PaperScene(SceneStageMethod):
    """Stage 1 as printed: the camera is the point map's, and points are not moved."""

    far_m: PositiveOrInfinite = math.inf
    floor: Literal["metric", "off"] = "metric"  # type: ignore[assignment]  # its own search
    """"metric" is the paper's RANSAC on the points of the floor mask, with its grid of floor
    points. "off" finds no floor.
    """
    carve_m: NotNegative = 0.0

    alignment = released_alignment_options(METRIC_DEPTH_TOLERANCE)
    rescales_depth = False

    def share_camera(
        self, points: Tensor, depth: Tensor, cameras: Cameras
    ) -> tuple[Tensor, Tensor, Cameras]:
        """Return the arguments: each map keeps its camera."""
        return points, depth, cameras

    def place_on_rays(
        self, points: Tensor, valid: Tensor, cameras: Cameras
    ) -> tuple[Tensor, Tensor]:
        """Return the points, moved for a given camera only, and that camera or the median of the
        point map's.
        """
        if cameras.stated is not None:
            return super().place_on_rays(points, valid, cameras)
        return points, scene_camera(points, valid, replace(cameras, metric_depth=None))

    def pixel_surface(self, points: Tensor, known: Tensor) -> PixelSurface:
        """Return normals over depth edges, no edges, and outliers by the distance to their
        neighbours.
        """
        return PixelSurface(
            pointmap_normals(points, known, math.inf),
            torch.zeros_like(known),
            _outliers_by_distance(points, known),
        )

    def search_floor(
        self, points: Tensor, valid: Tensor, surface: Tensor, evidence: FloorEvidence
    ) -> FloorSearch:
        """Find the floor in metres, on the points of its mask."""
        if self.floor == "off":
            return FloorSearch(None, "switched_off")
        return fit_floor_metric(points, surface, valid, evidence.mask)

    def sample_floor(self, floor: PlaneFit, known: Tensor, clean: Tensor, feet: Tensor) -> Tensor:
        """Return 10000 points of a grid over the extent of the scene."""
        return published_floor_grid(floor.normal, floor.offset, known, _GRID_SIDE)


@dataclass(frozen=True)
class ReleaseScene(PaperScene):
    """Stage 1 as released: as printed, with its normals, and without points of unusual normals."""

    def pixel_surface(self, points: Tensor, known: Tensor) -> PixelSurface:
        """Return the released normals, and outliers by their distances and by their normals."""
        outliers = _outliers_by_distance(points, known)
        normals = published_normals(points, known)
        kept = known & ~outliers
        outliers[kept] = published_normal_outliers(
            points[kept], normals[kept], int(KNN_SHARE * min(known.shape))
        )
        return PixelSurface(normals, torch.zeros_like(known), outliers)


@dataclass(frozen=True)
class ProxScene(SceneStageMethod):
    """Stage 1 as in the paper's comparison with PROX: the metric depth alone, without a floor."""

    floor: Literal["disparity", "off"] = "off"
    carve_m: NotNegative = 0.0

    uses_pointmap = False
    rescales_depth = False

    def pixel_surface(self, points: Tensor, known: Tensor) -> PixelSurface:
        """Return normals over depth edges; nothing is removed."""
        none = torch.zeros_like(known)
        return PixelSurface(pointmap_normals(points, known, math.inf), none, none)


def _outliers_by_distance(points: Tensor, known: Tensor) -> Tensor:
    """Return the outliers (H, W) bool among known points (H, W, 3)."""
    outliers = torch.zeros_like(known)
    outliers[known] = image_outliers(points[known], *known.shape)
    return outliers
