"""Pinhole camera of an image, and the trust in its intrinsics."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physic_core.types.arrays import FloatArray


class CameraTrust(StrEnum):
    """Reliability of camera intrinsics; a more reliable camera replaces a less reliable one."""

    KNOWN = "known"
    """Given by the user, the photo's EXIF data or a sensor."""

    ESTIMATED = "estimated"
    """Estimated from the photo, for example by a network or from vanishing points."""

    GUESSED = "guessed"
    """A default value, without information from the photo or its file."""


@dataclass(frozen=True)
class Intrinsics:
    """Intrinsics of a pinhole camera without distortion.

    Attributes:
        fx: focal length along x, px.
        fy: focal length along y, px.
        cx: principal point along x, px (integer coordinates are pixel centers).
        cy: principal point along y, px.
        width: image width, px.
        height: image height, px.
        source: origin of the numbers as text for people ("EXIF: 50 mm", "vanishing points"); no
            code depends on it.
        trust: a :class:`CameraTrust` or its value. State it for a known or a guessed camera.
        focal_sigma: standard deviation of the logarithm of the focal length, or None if it is not
            known.

    Raises:
        ValueError: a focal length is not positive and finite, or ``trust`` is not one of the three
            values.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    source: str = "given"
    trust: CameraTrust = CameraTrust.ESTIMATED
    focal_sigma: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "trust", CameraTrust(self.trust))
        if not (0 < self.fx < math.inf and 0 < self.fy < math.inf):
            raise ValueError(
                f"a focal length should be above 0 px, and finite (got fx {self.fx:g}, fy "
                f"{self.fy:g})"
            )

    @classmethod
    def from_focal(
        cls,
        focal_px: float,
        width: int,
        height: int,
        source: str = "given",
        trust: CameraTrust = CameraTrust.ESTIMATED,
    ) -> Intrinsics:
        """Create a camera with square pixels and the principal point in the image center."""
        return cls(
            focal_px, focal_px, (width - 1) / 2, (height - 1) / 2, width, height, source, trust
        )

    @property
    def known(self) -> bool:
        """Whether the intrinsics were given by the user, the file or a sensor."""
        return self.trust is CameraTrust.KNOWN

    @property
    def guessed(self) -> bool:
        """Whether the intrinsics are a default value."""
        return self.trust is CameraTrust.GUESSED

    @property
    def matrix(self) -> FloatArray:
        """Camera matrix, (3, 3) float64, px."""
        import numpy as np

        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def resized(self, width: int, height: int) -> Intrinsics:
        """Return the intrinsics for the same image resized to ``width`` x ``height`` px."""
        sx = width / self.width
        sy = height / self.height
        return replace(
            self,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
            width=width,
            height=height,
        )


@dataclass(frozen=True)
class Lens:
    """Camera of a photo file with lens distortion, Brown-Conrady model as in OpenCV.

    Attributes:
        intrinsics: of the upright file, px.
        distortion: k1, k2, p1, p2, k3.
    """

    intrinsics: Intrinsics
    distortion: tuple[float, float, float, float, float]

    def file_pixels(self, pixels: FloatArray, camera: Intrinsics) -> FloatArray:
        """Return the pixels (..., 2) of the file that show the same as pixels of an undistorted
        image.

        Args:
            pixels: (..., 2) x, y.
            camera: pinhole camera of the undistorted image.
        """
        import numpy as np

        points = np.asarray(pixels, np.float64)
        x = (points[..., 0] - camera.cx) / camera.fx
        y = (points[..., 1] - camera.cy) / camera.fy
        k1, k2, p1, p2, k3 = self.distortion
        square = x * x + y * y
        radial = 1 + square * (k1 + square * (k2 + square * k3))
        file_camera = self.intrinsics
        return np.stack(
            [
                file_camera.fx * (x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x))
                + file_camera.cx,
                file_camera.fy * (y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y)
                + file_camera.cy,
            ],
            -1,
        )
