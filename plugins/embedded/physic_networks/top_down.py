"""Networks that see one person or hand at a time: crop a box at the input size, and decode joints
from the output.

Boxes are half open, integer coordinates are pixel centres (:mod:`physic_core.types`). The centre of
a box is pixel coordinate (width / 2, height / 2) of its crop, as in MMPose's affine, HMR 2.0 and
WiLoR; with another grid results shift by half a pixel.

Decoded points are in px of the network's own grid; :class:`Crop` maps them to the photo.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, UInt8Array


@dataclass(frozen=True)
class Crop:
    """Affine mapping from the pixels of a crop to the photo: ``photo = origin + step * crop``.

    Attributes:
        origin: x and y of crop pixel (0, 0), px of the photo.
        step: photo px per crop pixel along x and y; x is negative in a mirrored crop.
        width: columns of the crop, px of the crop itself.
        height: rows of the crop, px of the crop itself.
    """

    origin: tuple[float, float]
    step: tuple[float, float]
    width: int
    height: int

    def to_photo(self, points: FloatArray) -> FloatArray:
        """Map points (..., 2) from px of the crop to px of the photo."""
        return np.asarray(self.origin) + np.asarray(self.step) * points

    def to_crop(self, points: FloatArray) -> FloatArray:
        """Map points (..., 2) from px of the photo to px of the crop."""
        in_crop: FloatArray = (points - np.asarray(self.origin)) / np.asarray(self.step)
        return in_crop

    @property
    def matrix(self) -> FloatArray:
        """The (2, 3) affine matrix from px of the crop to px of the photo."""
        return np.array([[self.step[0], 0.0, self.origin[0]], [0.0, self.step[1], self.origin[1]]])


def padded_region(
    box: FloatArray, aspect: float, padding: float = 1.25
) -> tuple[FloatArray, FloatArray]:
    """Return the centre (2,) and size (2,) of the smallest region of a fixed aspect around a box,
    enlarged.

    Args:
        box: (4,) x0 y0 x1 y1 px of the photo, half open.
        aspect: width over height.
        padding: factor on both sides.

    Returns:
        Centre in pixel-centre coordinates, and width and height, px of the photo. An empty box
        counts as one pixel.
    """
    corners = np.asarray(box, np.float64)
    center = (corners[:2] + corners[2:] - 1) / 2
    width, height = np.maximum(corners[2:] - corners[:2], 1.0)
    size = np.array([max(width, aspect * height), max(height, width / aspect)])
    return center, padding * size


def crop_around_box(
    box: FloatArray,
    width: int,
    height: int,
    *,
    padding: float = 1.25,
    mirrored: bool = False,
) -> Crop:
    """Return the mapping of a crop of ``width`` x ``height`` px around a box, without distortion.

    Args:
        box: (4,) x0 y0 x1 y1, half open, px of the photo; may be partly outside.
        width: columns of the crop, px of the crop itself.
        height: rows of the crop, px of the crop itself.
        padding: size of the region relative to the box.
        mirrored: exchange left and right about the centre of the region.
    """
    center, size = padded_region(box, width / height, padding)
    cells = np.array([width, height], np.float64)
    step = size / cells
    if mirrored:
        step = step * np.array([-1.0, 1.0])
    origin = center - step * cells / 2
    return Crop(
        (float(origin[0]), float(origin[1])), (float(step[0]), float(step[1])), width, height
    )


def antialias_sigma(crop: Crop) -> float:
    """Return the standard deviation of the anti-aliasing blur of HMR 2.0 and WiLoR, px of the
    photo.
    """
    half = abs(crop.step[0]) / 2
    return (half - 1) / 2 if half > 1.1 else 0.0


def resample_crop(image: UInt8Array, crop: Crop, *, sigma: float = 0.0) -> UInt8Array:
    """Resample a crop (height, width, 3) from an image (H, W, 3) by bilinear interpolation, black
    outside the image.

    Args:
        image: uint8.
        crop: which pixels.
        sigma: standard deviation of a Gaussian blur before resampling, px of the photo; 0 for none.
    """
    import cv2

    if sigma > 0:
        image = cv2.GaussianBlur(image, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE).astype(
            np.uint8
        )
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = (crop.width, crop.height)
    return np.asarray(cv2.warpAffine(image, crop.matrix, size, flags=flags), np.uint8)


def heatmap_peaks(heatmaps: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the position and value of the maximum of each heat map.

    Args:
        heatmaps: (N, J, h, w).

    Returns:
        Points (N, J, 2) and the values there (N, J).
    """
    n, j, h, w = heatmaps.shape
    flat = heatmaps.reshape(n, j, h * w)
    index = flat.argmax(-1)
    points = np.stack([index % w, index // w], -1).astype(np.float64)
    return points, np.take_along_axis(flat, index[..., None], -1)[..., 0].astype(np.float64)


def _step_to_peak(values: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the step (..., 2), right and down, from the middle of 3 x 3 values (3, 3, ...) to
    their peak, and whether they have one.
    """
    (up_left, up, _), (left, middle, right), (_, down, down_right) = values
    dx = (right - left) / 2
    dy = (down - up) / 2
    dxx = right - 2 * middle + left
    dyy = down - 2 * middle + up
    dxy = (down_right - right - down + 2 * middle - left - up + up_left) / 2
    determinant = dxx * dyy - dxy**2
    peaked = (dxx < 0) & (determinant > 1e-12)
    safe = np.where(peaked, determinant, 1.0)
    return np.stack([dxy * dy - dyy * dx, dxy * dx - dxx * dy], -1) / safe[..., None], peaked


_FLOOR = 1e-3  # least value of a heat map before its logarithm
_CEILING = 50.0  # its largest value
_SIGMA = 0.8  # standard deviation of the smoothing Gaussian, cells
_RADIUS = 5  # cells at which it is truncated
_FARTHEST = 1.0  # maximum distance of a peak from the highest cell, cells


def subpixel_peaks(heatmaps: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return sub-cell peaks by one Newton step on the logarithm of the smoothed map (DARK,
    arXiv:1910.06278).

    The logarithm of a Gaussian is a parabola, so one step from the highest cell reaches its centre.
    If the map has no peak there, or one more than a cell away, the centre of the highest cell is
    returned.

    Args:
        heatmaps: (N, J, h, w).

    Returns:
        Points (N, J, 2), and the values (N, J) of the unsmoothed maps at their highest cells.
    """
    from scipy.ndimage import gaussian_filter

    cells, value = heatmap_peaks(heatmaps)
    smooth = gaussian_filter(heatmaps.astype(np.float64), _SIGMA, radius=_RADIUS, axes=(2, 3))
    logs = np.pad(
        np.log(np.clip(smooth, _FLOOR, _CEILING)), ((0, 0), (0, 0), (1, 1), (1, 1)), mode="edge"
    )
    n, j = value.shape
    person = np.arange(n)[:, None]
    joint = np.arange(j)[None]
    columns = cells[..., 0].astype(int) + np.arange(3)[:, None, None]
    rows = cells[..., 1].astype(int) + np.arange(3)[:, None, None]
    step, peaked = _step_to_peak(logs[person, joint, rows[:, None], columns])
    near = peaked & (np.abs(step) <= _FARTHEST).all(-1)
    return cells + np.where(near[..., None], step, 0.0), value


def scores_to_confidence(scores: FloatArray) -> FloatArray:
    """Clip scores to [0, 1]; NaN becomes 0."""
    return np.clip(np.nan_to_num(scores, nan=0.0), 0.0, 1.0)
