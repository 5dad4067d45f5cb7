"""Calibrated cameras of the data sets, and people in the picture."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import Float64Array


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

    K: Float64Array
    width: int
    height: int
    R: Float64Array = field(default_factory=lambda: np.eye(3))
    t: Float64Array = field(default_factory=lambda: np.zeros(3))
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def project(self, points: Float64Array) -> Float64Array:
        """(..., 2) px of (..., 3) m of the world; NaN behind the camera."""
        inside = points @ self.R.T + self.t
        with np.errstate(invalid="ignore"):
            depth = np.where(inside[..., 2:] > 1e-6, inside[..., 2:], np.nan)
        return (inside / depth) @ self.K[:2].T

    def to_camera(self, points: Float64Array) -> Float64Array:
        """(..., 3) m of the world, in this camera's frame."""
        return points @ self.R.T + self.t

    def to_world(self, points: Float64Array) -> Float64Array:
        """(..., 3) m of this camera's frame, in the world's."""
        return (points - self.t) @ self.R


def project(points: Float64Array, K: Float64Array) -> Float64Array:
    """Return the pixels (n, 2) of points (n, 3) m of the camera frame; NaN behind the camera."""
    return Camera(np.asarray(K, np.float64), 0, 0).project(points)


def box_of_points(pixels: Float64Array) -> Float64Array:
    """Return the box (4,) px around the known pixels; an empty one if most are unknown."""
    finite = pixels[np.isfinite(pixels).all(-1)]
    if 2 * len(finite) < len(pixels) or len(finite) < 2:
        return np.zeros(4)
    return np.concatenate([finite.min(0), finite.max(0)])
