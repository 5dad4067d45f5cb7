"""Calibrated cameras of the data sets, pictures without the distortion of their lens, and people in
the picture.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Picture = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera with lens distortion; X_camera = R X_world + t, metres.

    Attributes:
        K: (3, 3) px; integer coordinates are pixel centres.
        width: px.
        height: px.
        R: (3, 3).
        t: (3,) m.
        distortion: k1, k2, p1, p2, k3, as in OpenCV. ``project`` is that of the undistorted
            picture, which has the same K.
    """

    K: Array
    width: int
    height: int
    R: Array = field(default_factory=lambda: np.eye(3))
    t: Array = field(default_factory=lambda: np.zeros(3))
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def project(self, points: Array) -> Array:
        """(..., 2) px of (..., 3) m of the world; NaN behind the camera."""
        inside = points @ self.R.T + self.t
        with np.errstate(invalid="ignore"):
            depth = np.where(inside[..., 2:] > 1e-6, inside[..., 2:], np.nan)
        pixels: Array = (inside / depth) @ self.K[:2].T
        return pixels

    def in_camera(self, points: Array) -> Array:
        """(..., 3) m of the world, in this camera's frame."""
        moved: Array = points @ self.R.T + self.t
        return moved

    def in_world(self, points: Array) -> Array:
        """(..., 3) m of this camera's frame, in the world's."""
        moved: Array = (points - self.t) @ self.R
        return moved

    @property
    def centre(self) -> Array:
        """(3,) m in the world."""
        place: Array = -self.R.T @ self.t
        return place


def calibrated(record: Mapping[str, Any]) -> tuple[Camera, tuple[int, int, int, int]]:
    """The camera of an entry of a ``cameras.json``, and the part (x0, y0, x1, y1) of the picture
    that shows something.

    A picture of another size than the calibrated one is that picture scaled by one factor and
    padded in the middle.
    """
    K = np.array(record.get("K", record.get("K_calibrated")), np.float64)
    width = int(record["width"])
    height = int(record["height"])
    full = (
        int(record.get("width_calibrated", width)),
        int(record.get("height_calibrated", height)),
    )
    factor = min(width / full[0], height / full[1])
    shown = [factor * side for side in full]
    left = round((width - shown[0]) / 2)
    top = round((height - shown[1]) / 2)
    # Of a warp that carries centre to centre, as the makers of the padded pictures used it.
    K[:2] *= factor
    K[:2, 2] += (width - shown[0]) / 2 - left, (height - shown[1]) / 2 - top
    width = width - 2 * left
    height = height - 2 * top
    camera = Camera(
        K, width, height, np.array(record["R"], np.float64), np.array(record["t_m"], np.float64)
    )
    return camera, (left, top, left + width, top + height)


def undistorted(picture: Picture, K: Array, distortion: Array) -> Picture:
    """The picture of the pinhole with the same matrix; unchanged where nothing is distorted."""
    if not np.any(distortion):
        return picture
    import cv2

    straight: Picture = cv2.undistort(picture, K, np.asarray(distortion, np.float64))
    return straight


def project(points: Array, K: Array) -> Array:
    """Return the pixels (n, 2) of points (n, 3) m of the camera frame; NaN behind the camera."""
    return Camera(np.asarray(K, np.float64), 0, 0).project(points)


def box_of_points(pixels: Array) -> Array | None:
    """Return the box (4,) px around the known pixels; None if most are unknown."""
    known = pixels[np.isfinite(pixels).all(-1)]
    if 2 * len(known) < len(pixels) or len(known) < 2:
        return None
    return np.concatenate([known.min(0), known.max(0)])
