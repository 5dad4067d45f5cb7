"""Maps of a world at the size that a network sees, and a photo whose channels differ."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates


def at(values, rows, columns):
    """A map at another size, bilinear between pixel centres, by SciPy."""
    v = (np.arange(rows) + 0.5) * values.shape[0] / rows - 0.5
    u = (np.arange(columns) + 0.5) * values.shape[1] / columns - 0.5
    return map_coordinates(
        values, np.stack(np.meshgrid(v, u, indexing="ij")), order=1, mode="nearest"
    )


def ramp(height, width, blue=77):
    """Red grows to the right, green upwards, blue is constant."""
    image = np.zeros((height, width, 3), np.uint8)
    image[..., 0] = np.linspace(20, 220, width)[None, :]
    image[..., 1] = np.linspace(200, 30, height)[:, None]
    image[..., 2] = blue
    return image
