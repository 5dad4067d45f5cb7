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


def expect_picture(photo, seen, tolerance, smoothed=1):
    """A network sees (3, h, w) grey levels: the photo, and not a mirrored or recoloured one.

    Blocks of ``smoothed`` px are compared where the two are resampled in different ways.
    """
    rows, columns = (n // smoothed for n in seen.shape[1:])
    wanted = np.stack([at(photo[..., c].astype(float), *seen.shape[1:]) for c in range(3)])
    blocks = [
        picture[:, : rows * smoothed, : columns * smoothed]
        .reshape(3, rows, smoothed, columns, smoothed)
        .mean((2, 4))
        for picture in (seen, wanted)
    ]
    assert np.abs(blocks[0] - blocks[1]).mean() < tolerance, (
        "not the photo, or not where it should lie"
    )
