"""Pinhole projection and unprojection, and the removal of a lens's distortion.

OpenCV axes (x right, y down, z forward), no skew. Integer pixel coordinates are pixel centres.
Leading dimensions broadcast; results have the dtype of the points.

Distortion is the Brown-Conrady model with OpenCV's five coefficients k1, k2, p1, p2, k3. A point
(x, y) of the pinhole camera, in units of the focal length, appears in the photo at

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y

with r^2 = x^2 + y^2. The undistorted picture keeps the camera matrix. Undistortion is kornia's
calibration module.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from physic_core.errors import ConfigError

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Intrinsics, UInt8Array

_MIN_DEPTH = 1e-3


def project(points: Tensor, K: Tensor) -> Tensor:
    """Project 3D points to pixel coordinates.

    Args:
        points: (..., 3) camera frame, any unit. Depths below 0.001 count as 0.001, so that the
            gradient stays finite.
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
    """Return the (x, y) coordinates (H, W, 2) of all pixel centres, with the dtype of
    ``like``.
    """
    v = torch.arange(height, dtype=like.dtype)
    u = torch.arange(width, dtype=like.dtype)
    return torch.stack((u.expand(height, width), v[:, None].expand(height, width)), dim=-1)


def pixel_rays(height: int, width: int, K: Tensor) -> Tensor:
    """Return the direction (H, W, 3) of the ray through each pixel centre, with z = 1."""
    ones = K.new_ones((height, width))
    return unproject(pixel_grid(height, width, K), ones, K)


def focal_px(K: Tensor) -> float:
    """Return the focal length of intrinsics (3, 3): the geometric mean of fx and fy, px."""
    return float((K[0, 0] * K[1, 1]).sqrt())


def mean_camera(first: Tensor, second: Tensor) -> Tensor:
    """Return the mean of two intrinsics (3, 3): geometric for focal lengths, arithmetic for the
    principal point.
    """
    mean = (first + second) / 2
    for axis in (0, 1):
        mean[axis, axis] = (first[axis, axis] * second[axis, axis]).sqrt()
    return mean


def intrinsics_matrix(fx: float, fy: float, cx: float, cy: float, like: Tensor) -> Tensor:
    """Return the intrinsics matrix (3, 3), px, with the dtype of ``like``."""
    return like.new_tensor([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


_RADII = 200


def check_distortion(camera: Intrinsics, distortion: Sequence[float]) -> None:
    """Check that the radial distortion does not fold the picture.

    Raises:
        ConfigError: towards the corners, larger angles appear nearer to the centre.
    """
    k1, k2, _, _, k3 = distortion
    x = max(camera.cx, camera.width - 1 - camera.cx) / camera.fx
    y = max(camera.cy, camera.height - 1 - camera.cy) / camera.fy
    r = np.linspace(0, np.hypot(x, y), _RADII)
    if (1 + 3 * k1 * r**2 + 5 * k2 * r**4 + 7 * k3 * r**6 <= 0).any():
        raise ConfigError(
            f"the distortion {', '.join(f'{v:g}' for v in distortion)} folds the picture onto "
            "itself near its corners: give k1, k2, p1, p2, k3 in OpenCV's order, with the "
            "intrinsics of the same calibration"
        )


def undistort_image(
    image: UInt8Array, camera: Intrinsics, distortion: Sequence[float]
) -> UInt8Array:
    """Return the picture (H, W, 3) uint8 of a camera of the same matrix without distortion; black
    where unknown.

    Args:
        camera: of the image.
        distortion: k1, k2, p1, p2, k3.
    """
    from kornia.geometry.calibration import undistort_image as undistort

    # Float32 pixels with a grid of float64 would be refused.
    picture = torch.tensor(image).permute(2, 0, 1)[None].to(torch.float64)
    straight = undistort(picture, *_matrix_and_coefficients(camera, distortion))[0]
    pixels: UInt8Array = (
        straight.round().clamp(0, 255).to(torch.uint8).permute(1, 2, 0).contiguous().numpy()
    )
    return pixels


_ITERATIONS = 50  # of the fixed point that inverts the distortion


def undistort_pixels(
    pixels: FloatArray, camera: Intrinsics, distortion: Sequence[float]
) -> FloatArray:
    """Return where pixels (N, 2) of the distorted picture are in the undistorted one, (N, 2) px."""
    from kornia.geometry.calibration import undistort_points

    points = torch.as_tensor(np.asarray(pixels, np.float64).reshape(1, -1, 2))
    straight: FloatArray = undistort_points(
        points, *_matrix_and_coefficients(camera, distortion), num_iters=_ITERATIONS
    )[0].numpy()
    return straight


def _matrix_and_coefficients(
    camera: Intrinsics, distortion: Sequence[float]
) -> tuple[Tensor, Tensor]:
    """Return the matrix (1, 3, 3) and the distortion (1, 5), float64."""
    coefficients = torch.tensor([list(distortion)], dtype=torch.float64)
    return torch.from_numpy(camera.matrix)[None].double(), coefficients
