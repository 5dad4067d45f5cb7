"""Stage 1: the scene in metres, with its camera, normals and floor (paper Sec. 3.1).

The relative point map brings the detail, the metric depth brings the scale (Eq. 1). OpenCV camera frame (x right,
y down, z forward).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from physic_core.engine.scene.camera import camera_of, of_one_camera
from physic_core.engine.settings import HumanSettings, SceneSettings
from physic_core.errors import BackendOutputError
from physic_core.geometry.alignment import Alignment, align, apply_alignment
from physic_core.geometry.camera import unproject
from physic_core.geometry.floor import FloorSearch, PlaneFit, fit_floor
from physic_core.geometry.floor_metric import fit_floor_metric
from physic_core.geometry.plane import height, sample_plane
from physic_core.geometry.pointmap import (
    depth_edges,
    depth_to_pointmap,
    knn_outliers,
    normals,
    unsupported,
)
from physic_core.geometry.released_pointmap import floor_lattice, four_neighbour_normals, normal_outliers
from physic_core.types import AffineAmbiguity
from physic_core.types.short_repr import ShortRepr

__all__ = [
    "SceneState",
    "alignment_diagnostics",
    "build_scene",
    "edge_ratio_at",
    "fit_relative_floor",
    "outlier_mask",
    "search_floor",
]

_REFERENCE_SIDE = 1024
_FLOOR_THICKNESS = 0.01


@dataclass(frozen=True)
class SceneState(ShortRepr):
    """The scene without its people, metres, camera frame.

    Attributes:
        points: (H, W, 3); every valid point projects onto its pixel (preset "paper": as the network gave it).
        normals: (H, W, 3) unit, facing the camera; zero where unreliable.
        valid: (H, W) bool; depth edges, outliers and what is beyond the far limit are not valid.
        floor_normal: (3,) unit, up, or None where no floor was found.
        floor_offset: height of the camera over the floor, metres; 0 without a floor.
        floor_points: (M, 3) on the floor, over the extent of the scene.
        floor_inlier_share: share of the searched pixels on the floor; of the best plane, where none was accepted.
        K: (3, 3) px, float64.
        alignment: of the relative point map to the metric depth.
        floor: the fit behind the floor, or None.
        diagnostics: numbers for the result, by topic.
    """

    points: Tensor
    normals: Tensor
    valid: Tensor
    floor_normal: Tensor | None
    floor_offset: float
    floor_points: Tensor
    floor_inlier_share: float
    K: Tensor
    alignment: Alignment
    floor: PlaneFit | None = None
    diagnostics: Mapping[str, Any] = field(default_factory=dict)

    @property
    def depth(self) -> Tensor:
        """(H, W) metres along z, NaN where no point is valid."""
        return torch.where(self.valid, self.points[..., 2], torch.nan)


def build_scene(
    points: Tensor,
    valid: Tensor,
    unknown: AffineAmbiguity,
    metric_depth: Tensor,
    *,
    K: Tensor | None = None,
    K_metric: Tensor | None = None,
    K_pointmap: Tensor | None = None,
    floor_mask: Tensor | None = None,
    hole: Tensor | None = None,
    feet_px: Tensor | None = None,
    settings: SceneSettings | None = None,
) -> SceneState:
    """Put a relative point map into metres and describe it.

    Args:
        points: (H, W, 3) relative point map of the inpainted photo.
        valid: (H, W) bool.
        unknown: what the point map leaves open.
        metric_depth: (H, W) metres along z, NaN where unknown.
        K: (3, 3) px, the camera where it is known: it wins over all others, and every point is put on its ray.
        K_metric: (3, 3) px, the camera that the metric depth was made for, or None.
        K_pointmap: (3, 3) px, the camera that the point map saw, or None; of "both" only.
        floor_mask: (H, W) bool, pixels that a segmenter calls floor, or None.
        hole: (H, W) bool, inpainted pixels, or None.
        feet_px: (F, 2) px, floor pixels at people's soles, or None.
        settings: of stage 1; preset "default" where None.

    Raises:
        BackendOutputError: the metric depth knows no pixel, or there is no camera to be had.
    """
    settings = settings or SceneSettings()
    if settings.intrinsics == "both":
        points, metric_depth, K_metric = of_one_camera(points, metric_depth, K, K_metric, K_pointmap)
    metric_valid = torch.isfinite(metric_depth) & (metric_depth > 0)
    if not bool(metric_valid.any()):
        raise BackendOutputError(
            "the metric depth knows no pixel: every depth is NaN, infinite or not positive; "
            "use another metric_depth backend, or check its notes"
        )
    alignment = _align_to_metric(points, valid, unknown, metric_depth, metric_valid, K, K_metric, settings)
    depth_alone = settings.source == "metric_depth"
    if alignment.inlier_share > 0 and not depth_alone:
        placed = apply_alignment(points, alignment)
        known = valid
    else:
        placed = depth_to_pointmap(metric_depth, camera_of(None, K, K_metric, points, valid, settings))
        known = metric_valid
    known = known & torch.isfinite(placed).all(-1) & (placed[..., 2] > 0)
    camera = camera_of(placed, K, K_metric, points, known, settings)
    if K is not None or settings.intrinsics != "pointmap":
        placed = depth_to_pointmap(placed[..., 2], camera)
    placed = torch.where(known[..., None], placed, 0.0)
    known = known & (placed[..., 2] <= settings.far_m)

    ratio = edge_ratio_at(settings.edge_ratio, *valid.shape)
    released = settings.normals == "released"
    surface = four_neighbour_normals(placed, known) if released else normals(placed, known, ratio)
    edges = depth_edges(placed[..., 2], known, ratio)
    drop = outlier_mask(placed, known & ~edges, settings)
    if released:
        kept = known & ~edges & ~drop
        drop[kept] = normal_outliers(placed[kept], surface[kept], int(settings.outlier_neighbors * min(valid.shape)))
    search = search_floor(placed, known & ~drop, surface, floor_mask, hole, feet_px, settings)
    floor = search.plane
    if floor is not None:
        # A floor that is seen at a grazing angle looks like a depth edge; its plane tells that it is none.
        z = placed[..., 2]
        on_floor = known & floor.inliers & (height(placed, floor.normal, floor.offset).abs() < _FLOOR_THICKNESS * z)
        edges, drop = edges & ~on_floor, drop & ~on_floor
        bare = on_floor & (surface == 0).all(-1)
        surface = torch.where(bare[..., None], floor.normal.to(surface), surface)
    clean = known & ~edges & ~drop
    return SceneState(
        points=placed,
        normals=surface,
        valid=clean,
        floor_normal=None if floor is None else floor.normal,
        floor_offset=0.0 if floor is None else floor.offset,
        floor_points=_floor_points(floor, placed, known if settings.floor_grid else clean, feet_px, camera, settings),
        floor_inlier_share=search.inlier_share,
        K=camera,
        alignment=alignment,
        floor=floor,
        diagnostics={
            "alignment": alignment_diagnostics(alignment),
            "valid_share": _share(clean),
            "edge_share": _share(edges),
            "outlier_share": _share(drop),
            "floor": _floor_diagnostics(search),
            "fx_px": float(camera[0, 0]),
            "fy_px": float(camera[1, 1]),
        },
    )


def fit_relative_floor(
    points: Tensor,
    valid: Tensor,
    floor_mask: Tensor | None = None,
    hole: Tensor | None = None,
    feet_px: Tensor | None = None,
    settings: SceneSettings | None = None,
) -> PlaneFit | None:
    """The floor in the units of a relative point map, before its scale is known; None where there is none.

    Always in inverse depth, since a tolerance in metres means nothing here; ``settings.floor`` "off" finds none.
    Arguments as in :func:`build_scene`.
    """
    settings = settings or SceneSettings()
    if settings.floor == "off":
        return None
    return _inverse_depth_search(points, valid, None, floor_mask, hole, feet_px, settings).plane


def search_floor(
    points: Tensor,
    valid: Tensor,
    surface: Tensor,
    floor_mask: Tensor | None,
    hole: Tensor | None,
    feet_px: Tensor | None,
    settings: SceneSettings,
) -> FloorSearch:
    """The floor of a metric point map (H, W, 3) with normals ``surface`` (H, W, 3), by the strategy of the settings."""
    if settings.floor == "off":
        return FloorSearch(None, "switched_off")
    if settings.floor == "metric":
        return fit_floor_metric(
            points,
            surface,
            valid,
            floor_mask,
            tolerance_m=settings.floor_tolerance_m,
            hypotheses=settings.floor_hypotheses,
            min_share=settings.floor_mask_min_share,
            max_below=settings.floor_max_below,
            seed=settings.seed,
        )
    return _inverse_depth_search(points, valid, surface, floor_mask, hole, feet_px, settings)


def _inverse_depth_search(
    points: Tensor,
    valid: Tensor,
    surface: Tensor | None,
    floor_mask: Tensor | None,
    hole: Tensor | None,
    feet_px: Tensor | None,
    settings: SceneSettings,
) -> FloorSearch:
    return fit_floor(
        points,
        valid,
        floor_mask=floor_mask,
        hole=hole,
        feet_px=feet_px,
        tolerance=settings.floor_tolerance,
        mask_slack=settings.floor_mask_slack,
        hypotheses=settings.floor_hypotheses,
        min_share=settings.floor_min_share,
        mask_min_share=settings.floor_mask_min_share,
        feet_min_share=settings.floor_feet_min_share,
        reanchor=settings.floor_reanchor,
        max_below=settings.floor_max_below,
        max_roll_deg=settings.floor_max_roll_deg,
        hole_weight=settings.floor_hole_weight,
        lower_share=settings.floor_lower_share,
        normals=surface,
        firmness=settings.floor_firmness,
        feet_window=settings.floor_feet_window,
        seed=settings.seed,
    )


def edge_ratio_at(ratio: float, rows: int, columns: int) -> float:
    """The depth ratio over 3 x 3 pixels that means the same slope as ``ratio`` in a picture of 1024 px.

    At most its square: in small pictures real edges are as sharp as in large ones.
    """
    return ratio ** min(2.0, _REFERENCE_SIDE / max(rows, columns, 1)) if math.isfinite(ratio) else ratio


def outlier_mask(
    points: Tensor, valid: Tensor, settings: SceneSettings | HumanSettings, size: tuple[int, int] | None = None
) -> Tensor:
    """(H, W) bool, valid points (H, W, 3) to be dropped, by the strategy of the settings.

    ``size`` is the (H, W) of the whole picture where ``points`` is only a part of it.
    """
    rows, columns = size or (valid.shape[0], valid.shape[1])
    if settings.outliers == "off" or not bool(valid.any()):
        return torch.zeros_like(valid)
    if settings.outliers == "grid":
        return unsupported(points[..., 2], valid, edge_ratio_at(settings.edge_ratio, rows, columns))
    drop = torch.zeros_like(valid)
    # The released code counts the point itself among its neighbours.
    neighbors = max(1, int(settings.outlier_neighbors * min(rows, columns)) - 1)
    drop[valid] = knn_outliers(points[valid], neighbors, settings.outlier_sigma)
    return drop


def alignment_diagnostics(alignment: Alignment) -> dict[str, Any]:
    """An alignment as plain numbers; a residual that does not exist is None."""
    return {
        "unknown": alignment.unknown,
        "scale": alignment.scale,
        "shift": alignment.shift,
        "inlier_share": alignment.inlier_share,
        "residual": alignment.residual if math.isfinite(alignment.residual) else None,
    }


def _align_to_metric(
    points: Tensor,
    valid: Tensor,
    unknown: AffineAmbiguity,
    metric_depth: Tensor,
    metric_valid: Tensor,
    K: Tensor | None,
    K_metric: Tensor | None,
    settings: SceneSettings,
) -> Alignment:
    """Eq. 1. Without any camera the target has no X and Y, and depth alone is aligned."""
    camera = K_metric if K_metric is not None else K
    depth = torch.where(metric_valid, metric_depth, 1.0)
    if camera is not None:
        target = depth_to_pointmap(depth, camera.to(depth))
    else:
        target = torch.stack((torch.zeros_like(depth), torch.zeros_like(depth), depth), -1)
    return align(
        points,
        valid,
        target,
        metric_valid,
        unknown,
        tolerance=settings.align_tolerance,
        iterations=settings.align_hypotheses,
        residual=settings.align_residual,
        axes="z" if camera is None else "xyz",
        max_pixels=settings.align_max_pixels,
        seed=settings.seed,
    )


def _floor_points(
    floor: PlaneFit | None,
    points: Tensor,
    valid: Tensor,
    feet_px: Tensor | None,
    camera: Tensor,
    settings: SceneSettings,
) -> Tensor:
    if floor is None:
        return points.new_zeros((0, 3))
    if settings.floor_grid:
        return floor_lattice(floor.normal, floor.offset, points[valid], settings.floor_grid)
    centres = None
    if feet_px is not None and len(feet_px):
        rays = unproject(feet_px.to(points), points.new_ones(len(feet_px)), camera)
        steepness = -(rays @ floor.normal)
        seen = steepness > 1e-3
        centres = rays[seen] * (floor.offset / steepness[seen])[:, None]
        centres = centres[centres[:, 2] <= settings.far_m]
    return sample_plane(
        floor.normal,
        floor.offset,
        points[valid],
        centres=centres,
        spacing=settings.floor_spacing_m,
        near=settings.floor_near_m,
        max_points=settings.floor_max_points,
    )


def _floor_diagnostics(search: FloorSearch) -> dict[str, Any]:
    told: dict[str, Any] = {
        "reason": search.reason,
        "inlier_share": search.inlier_share,
        "below_share": search.below_share,
        "mask_reason": search.mask_reason,
    }
    if search.plane is not None:
        x, y, z = (float(c) for c in search.plane.normal)
        told |= {
            "source": search.plane.source,
            "camera_height_m": search.plane.offset,
            "pitch_deg": math.degrees(math.atan2(-z, -y)),
            "roll_deg": math.degrees(math.atan2(x, -y)),
            "reanchored": search.plane.reanchored,
        }
    return told


def _share(mask: Tensor) -> float:
    return float(mask.double().mean())
