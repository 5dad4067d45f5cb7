"""Values of a hole interpolated from its surroundings, as an inpainter or a depth network would
continue them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray

_SWEEPS = 24  # of Jacobi's method at each resolution
_SMALLEST = 4  # px: an image of this side is not halved again


def fill_from_surroundings(values: FloatArray, hole: BoolArray) -> FloatArray:
    """Replace the values in a hole by a nearly harmonic interpolation of those around it.

    Laplace's equation is solved by Jacobi's method, from a coarse image to the full one. Without a
    pixel outside of the hole, the values stay as they are.

    Args:
        values: (H, W, C); those in the hole are not read, the others are finite.
        hole: (H, W) bool.

    Returns:
        (H, W, C) float64.
    """
    if hole.all() or not hole.any():
        return values.astype(np.float64)
    weight = (~hole).astype(np.float64)[..., None]
    return _fill(np.where(hole[..., None], 0.0, values.astype(np.float64)), weight)


def _fill(values: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the values (H, W, C) with those filled whose ``weight`` (H, W, 1) is 0; the others are
    unchanged.
    """
    if (weight > 0).all():
        return values
    if min(weight.shape[:2]) <= _SMALLEST:
        mean = (values * weight).sum((0, 1)) / weight.sum()
        return np.where(weight > 0, values, mean)
    coarse_weight = _sum_2x2(weight)
    coarse = _sum_2x2(values * weight) / np.maximum(coarse_weight, 1e-12)
    finer = np.repeat(np.repeat(_fill(coarse, (coarse_weight > 0).astype(np.float64)), 2, 0), 2, 1)
    filled = np.where(weight > 0, values, finer[: values.shape[0], : values.shape[1]])
    for _ in range(_SWEEPS):
        padded = np.pad(filled, ((1, 1), (1, 1), (0, 0)), mode="edge")
        mean = (padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]) / 4
        filled = np.where(weight > 0, values, mean)
    return filled


def _sum_2x2(values: FloatArray) -> FloatArray:
    """Return the sums (H / 2, W / 2, C) of 2 x 2 pixels, rounded up."""
    even = np.pad(values, ((0, values.shape[0] % 2), (0, values.shape[1] % 2), (0, 0)))
    return even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2]
