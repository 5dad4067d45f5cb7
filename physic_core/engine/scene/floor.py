"""Floor plane of stage 1: feet on it, and its diagnostics."""

from __future__ import annotations

import math
from typing import Any

from torch import Tensor

from physic_core.geometry.camera import unproject
from physic_core.geometry.floor import FloorSearch, PlaneFit

__all__ = ["floor_diagnostics", "intersect_feet"]


def intersect_feet(floor: PlaneFit, feet_px: Tensor | None, camera: Tensor, far_m: float) -> Tensor | None:
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
