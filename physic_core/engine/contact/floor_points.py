"""Distances of body vertices to the floor, where both its plane and points of the scene measure it. Metres.

Points of the floor are off by some centimetres. A vertex is near the nearest of them, so that it would touch the
highest point around it. The plane goes through all of them.
"""

from __future__ import annotations

from dataclasses import replace

import torch

from physic_core.engine.contact.distance import SurfaceDistances
from physic_core.engine.contact.scene_parts import SceneParts

__all__ = ["combine_floor_points"]

_POINT_SHARE = 0.35
"""Weight of the points; that of the plane is the rest."""

_MAX_SHIFT_M = 0.025
"""Largest difference between points and plane that is not an error of the points."""


def combine_floor_points(near: SurfaceDistances, parts: SceneParts) -> SurfaceDistances:
    """Replace distances to points of the floor by the mean of plane and point.

    Args:
        near: distances to scene and floor.
        parts: of the scene points that ``near.point`` indexes.

    Returns:
        The distances, infinite to points of the floor where the plane is within the search radius.
    """
    if not len(parts.ground):
        return near
    both = torch.isfinite(near.floor) & torch.isfinite(near.scene) & parts.ground.to(near.point.device)[near.point]
    apart = torch.where(both, near.scene - near.floor, 0.0).clamp(-_MAX_SHIFT_M, _MAX_SHIFT_M)
    return replace(
        near,
        floor=torch.where(both, near.floor + _POINT_SHARE * apart, near.floor),
        scene=torch.where(both, torch.inf, near.scene),
    )
