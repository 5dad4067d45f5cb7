"""Settings and steps of stage 1. An energy may override some of them in a subclass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

from torch import Tensor

from physic_core.engine.floor import FloorEvidence, find_floor
from physic_core.engine.scene.camera import Cameras, convert_to_common_camera, scene_camera
from physic_core.engine.scene.cleaning import edge_ratio
from physic_core.geometry.alignment import AlignmentOptions
from physic_core.geometry.floor import FloorSearch, PlaneFit, refit_floor
from physic_core.geometry.plane import sample_plane
from physic_core.geometry.pointmap import depth_edges, depth_to_pointmap, isolated_pixels, pointmap_normals
from physic_core.types.bounds import NotNegative, PositiveOrInfinite

METRIC_DEPTH_TOLERANCE = 0.1
"""Largest difference of point map and metric depth at an inlier, as a share of the depth."""


class PixelSurface(NamedTuple):
    """Surface at each pixel: normals (H, W, 3), depth edges (H, W) bool, and outliers (H, W) bool outside edges."""

    normals: Tensor
    edges: Tensor
    outliers: Tensor


@dataclass(frozen=True)
class SceneMethod:
    """Stage 1 of preset "default": metric scene points, camera, normals, floor (paper Sec. 3.1).

    Attributes:
        uses_pointmap: whether the scene is the aligned point map rather than the metric depth alone.
        alignment: options of Eq. 1.
        min_floor_share: minimum inlier share of an accepted floor.
        rescales_depth: whether metric depth gets the scale that it and the people say together, or keeps its own.
    """

    far_m: PositiveOrInfinite = 50.0
    """Points farther away are removed, metres."""
    floor: Literal["disparity", "off"] = "disparity"
    """"disparity" fits a plane in inverse depth. "off" finds no floor."""
    carve_m: NotNegative = 0.5
    """Largest distance by which inpainted scene points are moved behind a body that contains or should occlude them,
    metres; 0 moves none."""

    uses_pointmap: ClassVar[bool] = True
    alignment: ClassVar[AlignmentOptions] = AlignmentOptions(METRIC_DEPTH_TOLERANCE)
    min_floor_share: ClassVar[float] = 0.05
    rescales_depth: ClassVar[bool] = True

    def share_camera(self, points: Tensor, depth: Tensor, cameras: Cameras) -> tuple[Tensor, Tensor, Cameras]:
        """Return point map (H, W, 3), metric depth (H, W) and cameras, converted to one camera."""
        return convert_to_common_camera(points, depth, cameras)

    def place_on_rays(self, points: Tensor, valid: Tensor, cameras: Cameras) -> tuple[Tensor, Tensor]:
        """Return the metric points (H, W, 3) on the rays of their pixels, and the camera (3, 3) of these rays."""
        camera = scene_camera(points, valid, cameras)
        return depth_to_pointmap(points[..., 2], camera), camera

    def surface(self, points: Tensor, known: Tensor) -> PixelSurface:
        """Return the normals, and the removed pixels, of metric points (H, W, 3) that are known (H, W) bool."""
        ratio = edge_ratio(*known.shape)
        edges = depth_edges(points[..., 2], known, ratio)
        outliers = isolated_pixels(points[..., 2], known & ~edges, ratio)
        return PixelSurface(pointmap_normals(points, known, ratio), edges, outliers)

    def search_floor(self, points: Tensor, valid: Tensor, surface: Tensor, evidence: FloorEvidence) -> FloorSearch:
        """Return the floor in valid metric points (H, W, 3) with their normals, fitted again if it is known."""
        if self.floor == "off":
            return FloorSearch(None, "switched_off")
        if evidence.found is not None:
            return refit_floor(points, valid, evidence.found)
        return find_floor(points, valid, evidence, surface)

    def sample_floor(self, floor: PlaneFit, known: Tensor, clean: Tensor, feet: Tensor | None) -> Tensor:
        """Return points (F, 3) on the floor.

        Args:
            floor: of the scene.
            known: (M, 3) all points of the scene.
            clean: (N, 3) those that are neither edges nor outliers.
            feet: (K, 3) on the floor, or None.
        """
        return sample_plane(floor.normal, floor.offset, clean, centres=feet)
