"""Maps of a world on other grids, and which of its two photos a network is shown."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from physic_testing.worlds import World


def on_grid(values: np.ndarray, rows: int, columns: int, order: int = 1) -> np.ndarray:
    """A map (H, W) or (H, W, C) of the photo at the pixels of another grid over the whole of it."""
    height, width = values.shape[:2]
    v = (np.arange(rows) + 0.5) * height / rows - 0.5
    u = (np.arange(columns) + 0.5) * width / columns - 0.5
    grid = np.meshgrid(v, u, indexing="ij")
    if values.ndim == 2:
        return np.asarray(map_coordinates(values, grid, order=order, mode="nearest"))
    return np.stack([on_grid(values[..., c], rows, columns, order) for c in range(values.shape[2])], -1)


def logits(mask: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """A mask (H, W) over the whole photo on a grid: above 0 inside."""
    blur = 0.3 * max(mask.shape[0] / rows, mask.shape[1] / columns)
    return 20 * on_grid(gaussian_filter(mask.astype(float), blur) - 0.5, rows, columns)


def edges(mask: np.ndarray) -> np.ndarray:
    """(4,) x0 y0 x1 y1 px, half open."""
    columns, rows = np.flatnonzero(mask.any(0)), np.flatnonzero(mask.any(1))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], float)


def shows_people(world: World, picture: np.ndarray) -> bool:
    """Whether a picture (h, w, 3), 0 to 1, is nearer to the photo with the people than to the one without.

    Raises:
        AssertionError: it is neither, red, green, blue and upright.
    """
    apart = [
        np.abs(picture - on_grid(seen / 255, *picture.shape[:2])).mean() for seen in (world.image, world.empty_image)
    ]
    assert min(apart) < 0.025, f"another picture than that of the world: {min(apart):.3f} off"
    return bool(apart[0] < apart[1])
