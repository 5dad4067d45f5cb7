"""Test whether points lie in free space, in front of all surfaces of a depth map.

Beyond the rim of a surface, the normal of the nearest scene point does not tell inside from outside. For example, a
calf in front of a seat is below the seat's plane, but not inside the seat.
"""

from __future__ import annotations

import torch
from torch import Tensor


def front_depth(depth: Tensor) -> Tensor:
    """Return the least depth of each 2 x 2 pixel block: (H, W) -> (H - 1, W - 1); inf if none is finite.

    Four pixels, since at a depth edge a single one may show the background.
    """
    known = torch.where(torch.isfinite(depth), depth, torch.full_like(depth, torch.inf))
    rows = torch.minimum(known[:-1], known[1:])
    return torch.minimum(rows[:, :-1], rows[:, 1:])


def in_free_space(points: Tensor, front: Tensor, K: Tensor) -> Tensor:
    """Return whether each point (..., 3) lies in front of every surface of the depth map: (...) bool.

    Args:
        points: camera frame, in the unit of ``front``.
        front: (H - 1, W - 1), from :func:`front_depth`.
        K: (3, 3) px of the full image. Points outside the image or behind the camera are in free space.
    """
    K, z = K.to(points), points[..., 2]
    ahead = z > 1e-6
    away = torch.where(ahead, z, torch.ones_like(z))
    column = (K[0, 0] * points[..., 0] / away + K[0, 2]).floor()
    row = (K[1, 1] * points[..., 1] / away + K[1, 2]).floor()
    height, width = front.shape
    inside = ahead & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    flat = torch.where(inside, row * width + column, torch.zeros_like(row)).long()
    return ~(inside & (front.flatten()[flat] < z))
