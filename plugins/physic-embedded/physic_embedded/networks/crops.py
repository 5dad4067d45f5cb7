"""Cutting turned squares and letterboxed squares out of a photo, and carrying coordinates back.

Photo coordinates are pixels with integer pixel centres. Coordinates inside a cut are its own corner coordinates: 0 is
the left edge of the first pixel and ``size`` the right edge of the last, which is what the networks here speak.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.adapters.pictures import letterbox

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Float = NDArray[np.floating[Any]]
    Image = NDArray[np.uint8]

__all__ = ["Picture", "Square", "letterboxed"]


@dataclass(frozen=True)
class Square:
    """A square of the photo, turned about its centre.

    Attributes:
        center: (2,) px.
        side: px.
        angle: radians, positive turns the square's x axis towards the photo's y axis (clockwise on screen).
    """

    center: Float
    side: float
    angle: float

    @property
    def rotation(self) -> Float:
        """(2, 2), directions of the square to directions of the photo."""

        c, s = np.cos(self.angle), np.sin(self.angle)
        return np.array([[c, -s], [s, c]])

    def to_photo(self, points: Float, size: int) -> Float:
        """(..., 2) corner coordinates of a ``size`` x ``size`` cut -> photo px."""
        unit: Float = points / size - 0.5
        return self.center + unit @ self.rotation.T * self.side

    def from_photo(self, points: Float, size: int) -> Float:
        """(..., 2) photo px -> corner coordinates of a ``size`` x ``size`` cut."""
        unit: Float = (points - self.center) @ self.rotation / self.side
        return (unit + 0.5) * size


@dataclass(frozen=True)
class Picture:
    """A photo with its halved copies, so that a big photo is cut into small squares without aliasing.

    Attributes:
        levels: uint8 RGB images, each about half the size of the one before; the first is the photo.
    """

    levels: tuple[Image, ...]

    @classmethod
    def of(cls, image: Image, smallest: int = 128) -> Picture:
        """Halve ``image`` (H, W, 3) until the long side would fall below ``smallest`` px."""
        import cv2

        levels = [image]
        while max(levels[-1].shape[:2]) >= 2 * smallest and min(levels[-1].shape[:2]) > 1:
            h, w = levels[-1].shape[:2]
            levels.append(cv2.resize(levels[-1], ((w + 1) // 2, (h + 1) // 2), interpolation=cv2.INTER_AREA))
        return cls(tuple(levels))

    @property
    def height(self) -> int:
        """Rows of the photo."""
        return int(self.levels[0].shape[0])

    @property
    def width(self) -> int:
        """Columns of the photo."""
        return int(self.levels[0].shape[1])

    def cut(self, square: Square, size: int) -> Image:
        """The square resampled to (size, size, 3) uint8; black outside the photo."""
        import cv2

        # The coarsest level that still has a pixel for every pixel of the cut.
        k = int(np.clip(np.floor(np.log2(max(square.side / size, 1.0))), 0, len(self.levels) - 1))
        level = self.levels[k]
        scale = np.array([level.shape[1] / self.width, level.shape[0] / self.height])
        # Pixel (i, j) of the cut has its centre at corner coordinates (i + 1/2, j + 1/2).
        corner = np.array([[0.5, 0.5], [1.5, 0.5], [0.5, 1.5]])
        at = (square.to_photo(corner, size) + 0.5) * scale - 0.5
        matrix = np.stack([at[1] - at[0], at[2] - at[0], at[0]], axis=1)
        cut: Image = cv2.warpAffine(
            level, matrix, (size, size), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_CONSTANT
        )
        return cut


def letterboxed(image: Image, size: int, origin: tuple[int, int] = (0, 0)) -> tuple[Image, Square]:
    """Fit a part of the photo into the middle of a black square.

    Args:
        image: (H, W, 3).
        size: side of the square, px.
        origin: x and y of the part's first pixel in the photo.

    Returns:
        (size, size, 3) uint8, and the square of the photo that it shows, black bands included.
    """
    side = max(image.shape[:2])
    pixels, box = letterbox(image, size, size, how="area" if size < side else "bilinear")
    # The photo's corner coordinate 0 lies at pixel coordinate -1/2.
    bands = np.array([box.left, box.top], float)
    center = np.array(origin, float) - 0.5 + (size / 2 - bands) * side / size
    return pixels, Square(center, float(side), 0.0)
