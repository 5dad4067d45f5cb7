"""Fit the floor as a plane in a disparity map of unknown focal length, scale and offset.

A plane n . X = h gives 1 / z = (n . r) / h with the ray r = (x, y, 1), and a disparity is affine in
1 / z: so every plane of the scene is a plane over the pixels of the disparity map, for any camera
and any unknown scale and offset of the map.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_embedded.segmentation.floor_mask import LEAST_LABELLED

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray


_LABELLED_INLIERS = 0.4  # of the labelled pixels; a floor with fewer is looked for anywhere
_TOLERANCE = 0.012  # of an inlier, ranges of the disparity
_LEAST_RISE = 0.05  # from the top of the picture to its bottom, ranges


@dataclass(frozen=True)
class DisparityFloor:
    """Plane of the floor in a disparity map: disparity = ``x * du + y * dv + d0``.

    x and y are relative to the principal point, in units of the photo's long side.

    Attributes:
        du: slope along x.
        dv: slope along y, positive: nearer further down.
        d0: value at the principal point.
        inlier_share: share of the lower part of the picture that lies on the plane.
    """

    du: float
    dv: float
    d0: float
    inlier_share: float

    def normal(self, infinity: float, focal: float) -> FloatArray:
        """Return the downward unit normal (3,) of the floor, camera frame.

        ``infinity`` is the disparity at infinity; ``focal`` is the focal length in units of the
        photo's long side.
        """

        down = np.array([self.du * focal, self.dv * focal, self.d0 - infinity])
        return np.asarray(down / np.linalg.norm(down))


def fit_disparity_floor(
    disparity: FloatArray, made_up: BoolArray | None = None, labelled: BoolArray | None = None
) -> DisparityFloor | None:
    """Fit the lowest large plane of a disparity map, as
    :func:`physic_core.geometry.floor.plane_of_pixels` does.

    Args:
        disparity: (H, W), larger is nearer.
        made_up: (H, W) bool, pixels that an inpainter invented.
        labelled: (H, W) bool, pixels labelled as floor. They are the candidates, if they are enough
            and mostly lie on one plane; else the lower part of the picture is.

    Returns:
        The floor, or None where no plane looks like one.
    """
    import torch

    from physic_core.geometry import LOWER_SHARE, InverseDepthMap, optional_tensors, plane_of_pixels

    height, width = disparity.shape
    low, high = np.percentile(disparity, [1, 99])
    span = float(high - low)
    if span <= 0:
        return None
    rows, columns = np.mgrid[0:height, 0:width]
    rays = np.stack([columns - (width - 1) / 2, rows - (height - 1) / 2], -1) / max(height, width)
    pixels = torch.from_numpy(np.concatenate([rays, np.ones((height, width, 1))], -1))
    hole, mask = optional_tensors(made_up, labelled)
    everywhere = torch.ones(height, width, dtype=torch.bool)
    value = torch.from_numpy(np.asarray(disparity, np.float64))
    view = InverseDepthMap(pixels, value, everywhere, _TOLERANCE * span, _LEAST_RISE * span, hole)
    plane = None
    if mask is not None and float(mask.double().mean()) >= LEAST_LABELLED:
        plane = plane_of_pixels(view, mask, None, "labels")
        plane = plane if plane is None or plane.inlier_share >= _LABELLED_INLIERS else None
    plane = plane or plane_of_pixels(view, None, None, "lower image")
    if plane is None:
        return None
    rest = view.error(plane.by_ray)[round((1 - LOWER_SHARE) * height) :]
    on = (rest.abs() < view.tolerance).double().mean()
    du, dv, d0 = (float(p) for p in plane.by_ray)
    return DisparityFloor(du, dv, d0, float(on))
