"""Floor plane of stage 1: fit it by the configured method, and sample points on it."""

from __future__ import annotations

import math
from typing import Any, Literal

from torch import Tensor

from physic_core.geometry import floor as disparity_floor
from physic_core.geometry import floor_metric
from physic_core.geometry.camera import unproject
from physic_core.geometry.floor import FloorEvidence, FloorSearch, PlaneFit, fit_floor
from physic_core.geometry.published_pointmap import published_floor_grid

__all__ = [
    "feet_on_floor",
    "fit_relative_floor",
    "floor_diagnostics",
    "floor_grid",
    "min_inlier_share",
    "search_floor",
]

Strategy = Literal["disparity", "metric", "off"]

_GRID_SIDE = 100  # floor points along each side, as released


def fit_relative_floor(
    points: Tensor, valid: Tensor, evidence: FloorEvidence, strategy: Strategy = "disparity"
) -> PlaneFit | None:
    """Fit the floor to a relative point map of any unit; return None if no floor is found.

    Args:
        points: (H, W, 3), any unit.
        valid: (H, W) bool.
        evidence: of the floor.
        strategy: see ``SceneSettings.floor``; all but "off" fit in inverse depth, since the scale is unknown.
    """
    return None if strategy == "off" else fit_floor(points, valid, evidence).plane


def search_floor(
    points: Tensor, valid: Tensor, normals: Tensor, evidence: FloorEvidence, strategy: Strategy
) -> FloorSearch:
    """Find the floor in a metric point map (H, W, 3) with normals (H, W, 3), by a method of ``SceneSettings.floor``."""
    if strategy == "off":
        return FloorSearch(None, "switched_off")
    if strategy == "metric":
        return floor_metric.fit_floor_metric(points, normals, valid, evidence.mask)
    return fit_floor(points, valid, evidence, normals)


def min_inlier_share(strategy: Strategy) -> float:
    """Return the minimum share of inliers for the acceptance of a floor."""
    return floor_metric.MIN_INLIER_SHARE if strategy == "metric" else disparity_floor.MIN_INLIER_SHARE


def floor_grid(floor: PlaneFit, scene: Tensor) -> Tensor:
    """Sample 10000 floor points (10000, 3) over the extent of the scene (P, 3), metres, as in the released code."""
    return published_floor_grid(floor.normal, floor.offset, scene, _GRID_SIDE)


def feet_on_floor(floor: PlaneFit, feet_px: Tensor | None, camera: Tensor, far_m: float) -> Tensor | None:
    """Intersect the rays of feet pixels with the floor: (F, 3), at most ``far_m`` away; None without feet."""
    if feet_px is None or not len(feet_px):
        return None
    normal = floor.normal
    rays = unproject(feet_px.to(normal), normal.new_ones(len(feet_px)), camera)
    steepness = -(rays @ normal)
    seen = steepness > 1e-3
    centres = rays[seen] * (floor.offset / steepness[seen])[:, None]
    return centres[centres[:, 2] <= far_m]


def floor_diagnostics(search: FloorSearch) -> dict[str, Any]:
    """Return the diagnostics of a floor search."""
    found: dict[str, Any] = {
        "reason": search.reason,
        "inlier_share": search.inlier_share,
        "below_share": search.below_share,
        "mask_reason": search.mask_reason,
    }
    if search.plane is not None:
        x, y, z = (float(c) for c in search.plane.normal)
        found |= {
            "source": search.plane.source,
            "camera_height_m": search.plane.offset,
            "pitch_deg": math.degrees(math.atan2(-z, -y)),
            "roll_deg": math.degrees(math.atan2(x, -y)),
            "reanchored": search.plane.reanchored,
        }
    return found
