"""Local depth scale near each person, in addition to the global scale of the scene.

Depth networks have low-frequency errors of several percent between neighbouring objects. Each person has a warp: the
logarithm of a factor on the depth of nearby scene points. The floor is not warped. Metres, camera frame.
"""

from __future__ import annotations

import torch
from torch import Tensor

from physic_core.engine.joint.distances import plane_height

__all__ = ["log_local_scale", "warp_share"]

_FLOOR_M, _FREE_M = 0.03, 0.15  # metres over the floor: no warp below the first, full warp above the second
_NEAR_M, _FAR_M = 0.2, 1.0  # metres from a person's box: full warp below the first, none beyond the second
_MIN_WEIGHT_DISTANCE_M = 0.02  # added to the distance from a person's box in the inverse-square weight


def warp_share(points: Tensor, floor_normal: Tensor | None, floor_offset: float) -> Tensor:
    """Return the factor on a person's warp at points (..., 3): 0 on the floor, 1 far from it or without a floor."""
    if floor_normal is None:
        return torch.ones_like(points[..., 0])
    high = plane_height(points, floor_normal.to(points), points.new_tensor(floor_offset))
    return _smooth((high - _FLOOR_M) / (_FREE_M - _FLOOR_M))


def log_local_scale(
    points: Tensor, bodies: Tensor, warps: Tensor, floor_normal: Tensor | None, floor_offset: float
) -> Tensor:
    """Return the logarithm of the local depth scale of each point: the mean of nearby people's warps (log scales).

    ``max_i n_i * share * sum_i w_i warp_i / sum_i w_i`` with ``w_i = n_i / (d_i + 2 cm)^2``. d_i is the distance from
    person i's bounding box, n_i falls from 1 (20 cm) to 0 (1 m), and share is :func:`warp_share`.

    Args:
        points: (..., 3).
        bodies: (B, V, 3) finite vertices, in the unit of ``points``.
        warps: (B,) of the people.
        floor_normal: (3,) unit, up; None if there is no floor.
        floor_offset: of the floor, in the unit of ``points``.

    Returns:
        (...), 0 for points farther than 1 m from all people.
    """
    total, weights, nearest = (torch.zeros_like(points[..., 0]) for _ in range(3))
    for body, warp in zip(bodies, warps, strict=True):
        away = (torch.relu(body.amin(0) - points) + torch.relu(points - body.amax(0))).norm(dim=-1)
        near = 1 - _smooth((away - _NEAR_M) / (_FAR_M - _NEAR_M))
        weight = near / (away + _MIN_WEIGHT_DISTANCE_M).square()
        total += weight * warp
        weights += weight
        nearest = torch.maximum(nearest, near)
    share = warp_share(points, floor_normal, floor_offset)
    return nearest * share * total / weights.clamp(min=1e-9)


def _smooth(x: Tensor) -> Tensor:
    """Smoothstep: 0 at 0, 1 at 1, with zero slope at both ends."""
    x = x.clamp(0, 1)
    return x.square() * (3 - 2 * x)
