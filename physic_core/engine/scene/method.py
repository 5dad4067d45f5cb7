"""Settings and steps of stage 1, and the camera of a photo.

An energy may override some of the steps in a subclass.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal, NamedTuple

import torch
from torch import Tensor

from physic_core.engine.ground.floor import FloorEvidence
from physic_core.engine.up import level_plane
from physic_core.geometry.alignment import AlignmentOptions
from physic_core.geometry.camera import focal_px, intrinsics_matrix, mean_camera
from physic_core.geometry.floor import FloorSearch, PlaneFit, ray_to_floor, refit_floor
from physic_core.geometry.plane import sample_plane
from physic_core.geometry.pointmap import (
    depth_edges,
    depth_to_pointmap,
    edge_ratio,
    intrinsics_from_pointmap,
    isolated_pixels,
    pointmap_normals,
)
from physic_core.types.bounds import NotNegative, PositiveOrInfinite

METRIC_DEPTH_TOLERANCE = 0.1
"""Largest difference of point map and metric depth at an inlier, as a share of the depth."""


@dataclass(frozen=True)
class Cameras:
    """Intrinsics of a photo from several sources, each (3, 3) px or None if unknown.

    Attributes:
        stated: known camera. It overrides the others, and every point is moved onto the ray of its
            pixel.
        metric_depth: camera that the metric depth was estimated for.
        pointmap: camera that the relative point map was estimated for.
    """

    stated: Tensor | None = None
    metric_depth: Tensor | None = None
    pointmap: Tensor | None = None


def scene_camera(points: Tensor, valid: Tensor, cameras: Cameras) -> Tensor:
    """Return the intrinsics (3, 3) float64: given ones, otherwise those of the metric depth,
    otherwise from the point map.

    Args:
        points: (H, W, 3) point map, any unit.
        valid: (H, W) bool.
        cameras: of the photo.

    Raises:
        BackendOutputError: the camera cannot be estimated from the point map.
    """
    for stated in (cameras.stated, cameras.metric_depth):
        if stated is not None:
            return stated.to(torch.float64)
    fx, fy, cx, cy = intrinsics_from_pointmap(points, valid)
    return intrinsics_matrix(fx, fy, cx, cy, torch.zeros((), dtype=torch.float64))


class PixelSurface(NamedTuple):
    """Surface at each pixel: normals (H, W, 3), depth edges (H, W) bool, and outliers (H, W) bool
    outside edges.
    """

    normals: Tensor
    edges: Tensor
    outliers: Tensor


@dataclass(frozen=True)
class SceneStageMethod:
    """Stage 1 of preset "default": metric scene points, camera, normals, floor (paper Sec. 3.1).

    Attributes:
        uses_pointmap: whether the scene is the aligned point map rather than the metric depth
            alone.
        alignment: options of Eq. 1.
        rescales_depth: whether metric depth gets the scale of the vote with the people, or keeps
            its own.
    """

    far_m: PositiveOrInfinite = 50.0
    """Points farther away are removed, metres."""
    floor: Literal["disparity", "off"] = "disparity"
    """"disparity" fits a plane in inverse depth. "off" finds no floor."""
    carve_m: NotNegative = 0.5
    """Largest distance by which inpainted scene points are moved behind a body that contains or
    should occlude them, metres; 0 moves none.
    """

    uses_pointmap: ClassVar[bool] = True
    alignment: ClassVar[AlignmentOptions] = AlignmentOptions(METRIC_DEPTH_TOLERANCE)
    rescales_depth: ClassVar[bool] = True

    def share_camera(
        self, points: Tensor, depth: Tensor, cameras: Cameras
    ) -> tuple[Tensor, Tensor, Cameras]:
        """Convert point map and metric depth to the given camera, or to the mean of their two
        cameras if none is given.

        If only one of the two cameras is known, nothing is converted.

        Metric depth is proportional to the focal length, since depth networks infer it from the
        size of objects in pixels. The depth of the point map does not change, since its unit is
        unknown.

        Args:
            points: (H, W, 3), any unit.
            depth: (H, W) metres.
            cameras: of the photo.

        Returns:
            The converted points, the converted depth, and the cameras with ``metric_depth`` set to
            the common one.
        """
        common = cameras.stated
        metric = cameras.metric_depth
        pointmap = cameras.pointmap
        if common is None and metric is not None and pointmap is not None:
            common = mean_camera(metric.to(torch.float64), pointmap.to(torch.float64))
        if common is None:
            return (
                points,
                depth,
                replace(cameras, metric_depth=metric if metric is not None else pointmap),
            )
        if pointmap is not None:
            factor = torch.diagonal(pointmap)[:2].to(points) / torch.diagonal(common)[:2].to(points)
            points = torch.cat((points[..., :2] * factor, points[..., 2:]), -1)
        if metric is not None:
            depth = depth * (focal_px(common) / focal_px(metric))
        return points, depth, replace(cameras, metric_depth=common)

    def place_on_rays(
        self, points: Tensor, valid: Tensor, cameras: Cameras
    ) -> tuple[Tensor, Tensor]:
        """Return the metric points (H, W, 3) on the rays of their pixels, and the camera (3, 3) of
        these rays.
        """
        camera = scene_camera(points, valid, cameras)
        return depth_to_pointmap(points[..., 2], camera), camera

    def pixel_surface(self, points: Tensor, known: Tensor) -> PixelSurface:
        """Return the normals, and the removed pixels, of metric points (H, W, 3) that are known (H,
        W) bool.
        """
        ratio = edge_ratio(*known.shape)
        edges = depth_edges(points[..., 2], known, ratio)
        outliers = isolated_pixels(points[..., 2], known & ~edges, ratio)
        return PixelSurface(pointmap_normals(points, known, ratio), edges, outliers)

    def search_floor(
        self, points: Tensor, valid: Tensor, surface: Tensor, evidence: FloorEvidence
    ) -> FloorSearch:
        """Return the floor in valid metric points (H, W, 3) with their normals, fitted again and
        turned towards up if it is known.
        """
        if self.floor == "off" or evidence.known_search is None:
            return FloorSearch(None, "switched_off")
        search = refit_floor(points, valid, evidence.known_search)
        if search.plane is None or search.plane.beneath:
            return search
        rays = torch.where(valid[..., None], points / points[..., 2:], 0.0)
        at = ray_to_floor(rays, search.plane, evidence.feet_px)
        level = level_plane(search.plane, evidence.up, evidence.slope_sigma_deg, at)
        return replace(search, plane=level)

    def sample_floor(self, floor: PlaneFit, known: Tensor, clean: Tensor, feet: Tensor) -> Tensor:
        """Return points (F, 3) on the floor.

        Args:
            floor: of the scene.
            known: (M, 3) all points of the scene.
            clean: (N, 3) those that are neither edges nor outliers.
            feet: (K, 3) on the floor.
        """
        return sample_plane(floor.normal, floor.offset, clean, centres=feet)
