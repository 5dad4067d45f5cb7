"""Decode joints from the output of pose networks: heat maps to sub-pixel peaks, and SimCC.

All functions process people and joints at once. They return points in px of the network's own grid; integer coordinates
are cell centres. :class:`physic_core.adapters.crops.Crop` maps them to the photo.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import FloatArray

_FLOOR, _CEILING = 1e-3, 50.0  # of a heat map before its logarithm
_FARTHEST = 1.0  # maximum distance of a peak from the highest cell, cells


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


def subpixel_peaks(heatmaps: FloatArray, *, sigma: float = 0.8, radius: int = 5) -> tuple[FloatArray, FloatArray]:
    """Return sub-cell peaks by one Newton step on the logarithm of the smoothed map (DARK, arXiv:1910.06278).

    The logarithm of a Gaussian is a parabola, so one step from the highest cell reaches its centre. If the map has no
    peak there, or one more than a cell away, the centre of the highest cell is returned.

    Args:
        heatmaps: (N, J, h, w).
        sigma: standard deviation of the smoothing Gaussian, cells.
        radius: cells at which it is truncated.

    Returns:
        Points (N, J, 2), and the values (N, J) of the unsmoothed maps at their highest cells.
    """
    from scipy.ndimage import gaussian_filter

    cells, value = heatmap_peaks(heatmaps)
    smooth = gaussian_filter(heatmaps.astype(np.float64), sigma, radius=radius, axes=(2, 3))
    logs = np.pad(np.log(np.clip(smooth, _FLOOR, _CEILING)), ((0, 0), (0, 0), (1, 1), (1, 1)), mode="edge")
    n, j = value.shape
    person, joint = np.arange(n)[:, None], np.arange(j)[None]
    column, row = cells[..., 0].astype(int) + 1, cells[..., 1].astype(int) + 1

    def at(right: int, down: int) -> FloatArray:
        found: FloatArray = logs[person, joint, row + down, column + right]
        return found

    dx, dy = (at(1, 0) - at(-1, 0)) / 2, (at(0, 1) - at(0, -1)) / 2
    dxx, dyy = at(1, 0) - 2 * at(0, 0) + at(-1, 0), at(0, 1) - 2 * at(0, 0) + at(0, -1)
    dxy = (at(1, 1) - at(1, 0) - at(0, 1) + 2 * at(0, 0) - at(-1, 0) - at(0, -1) + at(-1, -1)) / 2
    determinant = dxx * dyy - dxy**2
    peaked = (dxx < 0) & (determinant > 1e-12)
    safe = np.where(peaked, determinant, 1.0)
    step = np.stack([dxy * dy - dyy * dx, dxy * dx - dxx * dy], -1) / safe[..., None]
    near = peaked & (np.abs(step) <= _FARTHEST).all(-1)
    return cells + np.where(near[..., None], step, 0.0), value


def scores_to_confidence(scores: FloatArray, full: float = 1.0) -> FloatArray:
    """Divide scores by ``full`` and clip them to [0, 1]; NaN becomes 0."""
    found: FloatArray = np.clip(np.nan_to_num(scores / full, nan=0.0), 0.0, 1.0)
    return found
