"""Free space: a point map shows the fronts of surfaces, and whatever lies before them is in the open.

Past the rim of a surface the nearest point of the scene lies on that rim, and its normal does not show on which side of
it a point lies: a calf before a seat is under the plane of the seat, but not inside it. The depth map shows which.
Metres, camera frame.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

__all__ = ["fronts", "in_free_space"]


def fronts(depth: Tensor) -> Tensor:
    """The nearest of each four pixels that meet: (H, W) along z -> (H - 1, W - 1); inf where none is known.

    Four, since at a rim one pixel alone may be the background's.
    """
    known = torch.where(torch.isfinite(depth), depth, torch.full_like(depth, torch.inf))
    return -F.max_pool2d(-known[None, None], 2, stride=1)[0, 0]


def in_free_space(points: Tensor, fronts: Tensor, K: Tensor) -> Tensor:
    """Whether nothing that was seen lies before each point (..., 3): (...) bool.

    Args:
        points: in the unit of the fronts.
        fronts: (H - 1, W - 1), from :func:`fronts`.
        K: (3, 3) px of the whole picture. Outside the picture, and behind the camera, nothing was seen.
    """
    K, z = K.to(points), points[..., 2]
    ahead = z > 1e-6
    away = torch.where(ahead, z, torch.ones_like(z))
    column = (K[0, 0] * points[..., 0] / away + K[0, 2]).floor()
    row = (K[1, 1] * points[..., 1] / away + K[1, 2]).floor()
    height, width = fronts.shape
    inside = ahead & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    flat = torch.where(inside, row * width + column, torch.zeros_like(row)).long()
    return ~(inside & (fronts.flatten()[flat] < z))
