"""Crop rotated and letterboxed squares from a photo, and convert coordinates between crop and
photo.

Photo coordinates are pixels with integer pixel centres. Crop coordinates are pixel edges: 0 is the
left edge of the first pixel and ``size`` the right edge of the last, as the networks here use them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_networks.pictures import letterbox

if TYPE_CHECKING:
    from physic_core.types import FloatArray, UInt8Array


@dataclass(frozen=True)
class RotatedSquare:
    """Square of a photo, rotated about its centre.

    Attributes:
        center: (2,) px.
        side: px.
        angle: radians, positive turns the square's x axis towards the photo's y axis (clockwise on
            screen).
    """

    center: FloatArray
    side: float
    angle: float

    @classmethod
    def upright(cls, center: FloatArray, side: float, up: FloatArray) -> RotatedSquare:
        """Return the square in which a direction (2,) of the photo points up."""
        return cls(center, side, float(np.arctan2(up[0], -up[1])))

    @property
    def rotation(self) -> FloatArray:
        """Rotation (2, 2) from directions in the square to directions in the photo."""
        c = np.cos(self.angle)
        s = np.sin(self.angle)
        return np.array([[c, -s], [s, c]])

    def to_photo(self, points: FloatArray, size: int) -> FloatArray:
        """Convert crop coordinates (..., 2) of a ``size`` x ``size`` crop to photo pixels."""
        unit: FloatArray = points / size - 0.5
        return self.center + unit @ self.rotation.T * self.side

    def from_photo(self, points: FloatArray, size: int) -> FloatArray:
        """Convert photo pixels (..., 2) to crop coordinates of a ``size`` x ``size`` crop."""
        unit: FloatArray = (points - self.center) @ self.rotation / self.side
        return (unit + 0.5) * size


_SMALLEST_PX = 128  # long side of a level


@dataclass(frozen=True)
class ImagePyramid:
    """Photo with half-size copies, so that crops of a large photo are not aliased.

    Attributes:
        levels: uint8 RGB images, each about half the size of the one before; the first is the
            photo.
    """

    levels: tuple[UInt8Array, ...]

    @classmethod
    def from_image(cls, image: UInt8Array) -> ImagePyramid:
        """Build a pyramid of an image (H, W, 3), halved until its long side would fall below
        128 px.
        """
        import cv2

        levels = [image]
        while max(levels[-1].shape[:2]) >= 2 * _SMALLEST_PX and min(levels[-1].shape[:2]) > 1:
            h, w = levels[-1].shape[:2]
            levels.append(
                cv2.resize(levels[-1], ((w + 1) // 2, (h + 1) // 2), interpolation=cv2.INTER_AREA)
            )
        return cls(tuple(levels))

    @property
    def height(self) -> int:
        """Height of the photo, px."""
        return int(self.levels[0].shape[0])

    @property
    def width(self) -> int:
        """Width of the photo, px."""
        return int(self.levels[0].shape[1])

    def crop(self, square: RotatedSquare, size: int) -> UInt8Array:
        """Resample a square to (size, size, 3) uint8; black outside the photo."""
        import cv2

        # The coarsest level that still has a pixel for every pixel of the cut.
        k = int(np.clip(np.floor(np.log2(max(square.side / size, 1.0))), 0, len(self.levels) - 1))
        level = self.levels[k]
        scale = np.array([level.shape[1] / self.width, level.shape[0] / self.height])
        # Pixel (i, j) of the cut has its centre at corner coordinates (i + 1/2, j + 1/2).
        corner = np.array([[0.5, 0.5], [1.5, 0.5], [0.5, 1.5]])
        source_corners = (square.to_photo(corner, size) + 0.5) * scale - 0.5
        matrix = np.stack(
            [
                source_corners[1] - source_corners[0],
                source_corners[2] - source_corners[0],
                source_corners[0],
            ],
            axis=1,
        )
        cut: UInt8Array = cv2.warpAffine(
            level,
            matrix,
            (size, size),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_CONSTANT,
        )
        return cut


def letterbox_square(
    image: UInt8Array, size: int, origin: tuple[int, int] = (0, 0)
) -> tuple[UInt8Array, RotatedSquare]:
    """Resize an image into the middle of a black square.

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
    return pixels, RotatedSquare(center, float(side), 0.0)
