"""Lens distortion of the Brown-Conrady model with OpenCV's five coefficients k1, k2, p1, p2, k3.

A point (x, y) of the pinhole camera, in units of the focal length, appears in the photo at

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y

with r^2 = x^2 + y^2. The undistorted picture keeps the camera matrix. Undistortion is kornia's calibration module.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch

from physic_core.errors import InputError

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.types import FloatArray, Intrinsics, UInt8Array

_ITERATIONS = 50  # of the fixed point that inverts the distortion
_RADII = 200


def check_distortion(camera: Intrinsics, distortion: Sequence[float]) -> None:
    """Check that the radial distortion does not fold the picture.

    Raises:
        InputError: towards the corners, larger angles appear nearer to the centre.
    """
    k1, k2, _, _, k3 = distortion
    x = max(camera.cx, camera.width - 1 - camera.cx) / camera.fx
    y = max(camera.cy, camera.height - 1 - camera.cy) / camera.fy
    r = np.linspace(0, np.hypot(x, y), _RADII)
    if (1 + 3 * k1 * r**2 + 5 * k2 * r**4 + 7 * k3 * r**6 <= 0).any():
        raise InputError(
            f"the distortion {', '.join(f'{v:g}' for v in distortion)} folds the picture onto itself near its corners: "
            "give k1, k2, p1, p2, k3 in OpenCV's order, with the intrinsics of the same calibration"
        )


def undistort_image(image: UInt8Array, camera: Intrinsics, distortion: Sequence[float]) -> UInt8Array:
    """Return the picture (H, W, 3) uint8 of a camera of the same matrix without distortion; black where unknown.

    Args:
        camera: of the image.
        distortion: k1, k2, p1, p2, k3.
    """
    from kornia.geometry.calibration import undistort_image as undistort

    K, coefficients = _tensors(camera, distortion, torch.float64)
    # Float32 pixels with a grid of float64 would be refused.
    picture = torch.tensor(image).permute(2, 0, 1)[None].to(torch.float64)
    found = undistort(picture, K[None], coefficients[None])[0]
    pixels: UInt8Array = found.round().clamp(0, 255).to(torch.uint8).permute(1, 2, 0).contiguous().numpy()
    return pixels


def undistort_pixels(pixels: FloatArray, camera: Intrinsics, distortion: Sequence[float]) -> FloatArray:
    """Return where pixels (N, 2) of the distorted picture are in the undistorted one, (N, 2) px."""
    from kornia.geometry.calibration import undistort_points

    K, coefficients = _tensors(camera, distortion, torch.float64)
    points = torch.as_tensor(np.asarray(pixels, np.float64).reshape(1, -1, 2))
    found: FloatArray = undistort_points(points, K[None], coefficients[None], num_iters=_ITERATIONS)[0].numpy()
    return found


def _tensors(camera: Intrinsics, distortion: Sequence[float], dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    return torch.from_numpy(camera.matrix).to(dtype), torch.tensor(list(distortion), dtype=dtype)
