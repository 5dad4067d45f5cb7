"""Masks and depth maps that show the photo otherwise are named."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.geometry.depth_comparison import SURELY, compare_depth, turned_masks
from physic_core.types import Intrinsics, Pointmap

MASKS = np.zeros((2, 120, 160), bool)
MASKS[0, 20:110, 10:40] = True
MASKS[1, 40:110, 70:95] = True


@pytest.mark.parametrize(
    ("given", "what"),
    [
        (MASKS, ""),
        (MASKS[..., ::-1], "mirrored"),
        (MASKS[:, ::-1], "upside down"),
        (MASKS[:, ::-1, ::-1], "turned by 180 degrees"),
        (MASKS.any(0)[None], ""),
        (~MASKS.any(0)[None], "inverted"),
        (np.roll(MASKS, 4, 2), ""),
        (np.roll(MASKS, 14, 2), "moved by +8% to the right and +0% down"),
    ],
)
def test_masks_of_a_turned_picture_are_named(given, what):
    assert turned_masks(given, MASKS).partition(":")[0] == what


@pytest.mark.parametrize(
    ("rows", "columns", "where"),
    [
        (slice(15, 105), slice(0, 160), "at the top and bottom"),
        (slice(0, 120), slice(35, 125), "at the sides"),
    ],
)
@pytest.mark.parametrize("bars", [np.nan, 9.0])
def test_a_depth_map_with_bars_is_named(rows, columns, where, bars):
    down, right = np.mgrid[:120, :160]
    depth = np.where(down > 70, 4 * 50 / (down - 20.0 + 1e-6), 4.0)
    depth = np.where((right > 30) & (right < 60) & (down > 25), 2.0, depth)
    depth = np.where((right > 110) & (down > 55), 1.6, depth)
    camera = Intrinsics(150, 150, 79.5, 59.5, 160, 120)
    points = np.stack(
        [(right - 79.5) * depth / 150, (down - 59.5) * depth / 150, depth], -1
    ).astype(np.float32)
    seen = Pointmap(points, np.ones(depth.shape, bool), "scale")
    assert not compare_depth(depth, (seen,), camera).best_reading
    padded = np.full_like(depth, bars)
    height, width = padded[rows, columns].shape
    y = (np.arange(height) + 0.5) * 120 / height
    x = (np.arange(width) + 0.5) * 160 / width
    padded[rows, columns] = depth[y.astype(int)][:, x.astype(int)]
    found = compare_depth(padded, (seen,), camera)
    assert found.ratio <= SURELY
    assert found.best_reading == f"of a picture with bars {where}"
