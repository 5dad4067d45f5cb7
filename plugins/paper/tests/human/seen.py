"""Which part of a photo a crop shows.

A picture of coordinates stands in for the photo that crops are made of: red grows from left to
right, green from top to bottom, blue is the same everywhere. So a crop says itself where it was
taken, whether it is mirrored and in which order its channels come, whatever code made it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_erosion

BLUE = 64
MEAN = np.array([0.485, 0.456, 0.406])
STD = np.array([0.229, 0.224, 0.225])


def coordinates(height, width):
    """The picture of coordinates (H, W, 3) uint8."""
    picture = np.full((height, width, 3), BLUE, np.uint8)
    picture[..., 0] = np.round(40 + 200 * np.arange(width) / width)
    picture[..., 1] = np.round(40 + 200 * np.arange(height) / height)[:, None]
    return picture


class Place(NamedTuple):
    """Where a crop was taken.

    Attributes:
        origin: (2,) px of the photo at crop pixel (0, 0).
        step: (2,) px of the photo from one crop pixel to the next; x is negative in a mirrored
            crop.
        side: of the crop, px of the crop.
    """

    origin: np.ndarray
    step: np.ndarray
    side: int

    def at(self, share):
        """(2,) px of the photo at the same share of both sides, 0.5 being crop pixel side / 2."""
        return self.origin + self.step * share * self.side


def place_of(crop, height, width):
    """From a crop (S, S, 3) of the picture of coordinates of a photo, red, green, blue in grey
    levels.

    Raises:
        AssertionError: its channels come in another order.
    """
    # Pixels at the border of the photo are mixed with what is outside.
    inside = binary_erosion(crop.min(axis=2) > 30, iterations=4)
    assert inside.sum() > 50, "a crop of nothing"
    colors = crop[inside]
    assert abs(np.median(colors[:, 2]) - BLUE) < 4, f"blue is {np.median(colors, axis=0)}"
    lines = [
        np.polyfit(places, (values - 40) / 200 * size, 1)
        for places, values, size in zip(
            np.nonzero(inside)[::-1], colors.T[:2], (width, height), strict=True
        )
    ]
    step, origin = np.transpose(lines)
    return Place(origin, step, crop.shape[1])


def normalised_back(planes):
    """(3, S, S) of a network -> (S, S, 3) grey levels."""
    return 255 * (planes.transpose(1, 2, 0) * STD + MEAN)
