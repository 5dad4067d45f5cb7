"""Pinhole projection and unprojection.

OpenCV axes (x right, y down, z forward), no distortion, no skew. Integer pixel coordinates are pixel centres. Leading
dimensions broadcast; results have the dtype and device of the points.
"""

from __future__ import annotations

import torch
from torch import Tensor

_MIN_DEPTH = 1e-3


def project(points: Tensor, K: Tensor) -> Tensor:
    """Project 3D points to pixel coordinates.

    Args:
        points: (..., 3) camera frame, any unit. Depths below 0.001 count as 0.001, so that the gradient stays finite.
        K: (3, 3) px, or (..., 3, 3) that broadcasts with the leading dimensions of ``points``.

    Returns:
        (..., 2) px.
    """
    K = K.to(points)
    focal = K[..., :2, :2].diagonal(dim1=-2, dim2=-1)
    return focal * (points[..., :2] / points[..., 2:].clamp(min=_MIN_DEPTH)) + K[..., :2, 2]


def unproject(uv: Tensor, depth: Tensor, K: Tensor) -> Tensor:
    """Unproject pixels with z-depth to 3D points; the inverse of :func:`project`.

    Args:
        uv: (..., 2) px.
        depth: (...) along z (not along the ray), any unit.
        K: (3, 3) px, or broadcasting as in :func:`project`.

    Returns:
        (..., 3) camera frame, the unit of ``depth``.
    """
    K = K.to(depth)
    x = (uv[..., 0] - K[..., 0, 2]) / K[..., 0, 0]
    y = (uv[..., 1] - K[..., 1, 2]) / K[..., 1, 1]
    return torch.stack((x * depth, y * depth, depth), dim=-1)


def pixel_grid(height: int, width: int, like: Tensor) -> Tensor:
    """Return the (x, y) coordinates (H, W, 2) of all pixel centres, with the dtype and device of ``like``."""
    v = torch.arange(height, dtype=like.dtype, device=like.device)
    u = torch.arange(width, dtype=like.dtype, device=like.device)
    return torch.stack((u.expand(height, width), v[:, None].expand(height, width)), dim=-1)


def pixel_rays(height: int, width: int, K: Tensor) -> Tensor:
    """Return the direction (H, W, 3) of the ray through each pixel centre, with z = 1."""
    ones = K.new_ones((height, width))
    return unproject(pixel_grid(height, width, K), ones, K)


def focal_px(K: Tensor) -> float:
    """Return the focal length of intrinsics (3, 3): the geometric mean of fx and fy, px."""
    return float((K[0, 0] * K[1, 1]).sqrt())


def mean_camera(first: Tensor, second: Tensor) -> Tensor:
    """Return the mean of two intrinsics (3, 3): geometric for focal lengths, arithmetic for the principal point."""
    mean = (first + second) / 2
    for axis in (0, 1):
        mean[axis, axis] = (first[axis, axis] * second[axis, axis]).sqrt()
    return mean


def intrinsics_matrix(fx: float, fy: float, cx: float, cy: float, like: Tensor) -> Tensor:
    """Return the intrinsics matrix (3, 3), px, with the dtype and device of ``like``."""
    return like.new_tensor([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
