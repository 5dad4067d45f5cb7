"""Recover focal length and z-shift of an affine point map (known up to scale and z-shift).

Networks such as MoGe return points (x, y, z). For some shift s and focal length f, every point is
on the ray of its pixel: f x / (z + s) = u and f y / (z + s) = v, with u and v relative to the image
centre. For each shift, the best f has a closed form, so only s is searched. All shifts that keep
the points in front of the camera are considered.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import BackendError
from physic_core.types import CameraTrust, Intrinsics

if TYPE_CHECKING:
    from collections.abc import Callable

    from physic_core.types import BoolArray, FloatArray

_GRID = 64
"""Rows and columns of the grid of sampled points."""
_MIN_SAMPLES = 64
"""With fewer valid points on the grid, points are sampled from all valid ones."""
_MAX_UNCERTAINTY = 0.7
"""Maximum of :meth:`_Problem.uncertainty`.

The error of log(focal length) is about two thirds of it.
"""


@dataclass(frozen=True)
class AffineCamera:
    """Focal length and z-shift of an affine point map.

    Attributes:
        fx: focal length along x, px.
        fy: focal length along y, px; equal to ``fx`` unless two were given.
        shift: to add to z, in the units of the points.
        determined: whether the points determine the focal length. Those of a flat wall parallel to
            the image do not. The shift is then the smallest that keeps all points in front of the
            camera, and the focal length is the best for it.
    """

    fx: float
    fy: float
    shift: float
    determined: bool = True

    def intrinsics(self, width: int, height: int, source: str) -> Intrinsics:
        """Return intrinsics with the principal point in the image centre, marked as guessed if not
        ``determined``.
        """
        trust = CameraTrust.ESTIMATED if self.determined else CameraTrust.GUESSED
        return replace(Intrinsics.from_focal(self.fx, width, height, source, trust), fy=self.fy)


def half_diagonal(height: int, width: int) -> float:
    """Return half the image diagonal in px, the unit of the focal length in MoGe's code."""
    return float((height**2 + width**2) ** 0.5 / 2)


def recover_camera(
    points: FloatArray, mask: BoolArray, focal_px: float | tuple[float, float] | None = None
) -> AffineCamera:
    """Estimate focal length and shift of an affine point map by least squares in the image plane.

    Args:
        points: (H, W, 3), x right, y down, z forward, up to scale and z-shift.
        mask: (H, W) bool, valid points.
        focal_px: known focal length, or those along x and y; then only the shift is estimated. None
            if unknown.

    Raises:
        BackendError: too few points, or no positive focal length fits them.
    """
    xyz, uv = _sampled(points, np.asarray(mask, bool))
    known_focal = None if focal_px is None else np.broadcast_to(np.asarray(focal_px, np.float64), 2)
    half = half_diagonal(*points.shape[:2])
    if known_focal is not None:
        if not (np.isfinite(known_focal).all() and known_focal.min() > 0):
            raise BackendError(f"a focal length must be a number of px above 0, got {focal_px}")
        uv = uv * (half / known_focal)  # so that the focal length is 1
    problem = _Problem(xyz[:, :2], xyz[:, 2], uv)
    lowest, size = problem.lowest_shift()
    # how far the nearest point is in front of the camera
    nearest = np.geomspace(1e-4, 1e4, 97) * size
    if known_focal is not None:
        shift = _minimise(problem.error_at_1, problem.slope_at_1, lowest, nearest)
        return AffineCamera(float(known_focal[0]), float(known_focal[1]), shift)
    shift = _minimise(problem.error, problem.slope, lowest, nearest)
    determined = problem.focal(shift) > 0 and problem.uncertainty(shift) < _MAX_UNCERTAINTY
    if not determined:
        shift = max(0.0, lowest + 1e-3 * size)
    focal = problem.focal(shift) * half
    if not (np.isfinite(focal) and focal > 0):
        raise BackendError(
            "no focal length fits the point map: its points do not lie like the pixels "
            "(x has to grow to the right and y downwards)"
        )
    return AffineCamera(focal, focal, shift, determined=bool(determined))


def points_on_rays(
    z: FloatArray, mask: BoolArray, affine: AffineCamera, camera: Intrinsics, scale: float = 1.0
) -> tuple[FloatArray, BoolArray]:
    """Add the z-shift to an affine point map, scale it, and place each point on the ray of its
    pixel.

    Args:
        z: (H, W), z of the points.
        mask: (H, W) bool, valid points.
        affine: result of :func:`recover_camera`.
        camera: of the image.
        scale: metres per unit of the points, or 1.

    Returns:
        (H, W, 3) float32 points on the rays of their pixels with depth (z + shift) * scale, NaN
        where invalid; and (H, W) bool, the valid points: inside the mask, finite, in front of the
        camera.
    """
    height, width = mask.shape
    with np.errstate(invalid="ignore"):
        depth = (np.asarray(z, np.float64) + affine.shift) * scale
        valid = mask & np.isfinite(depth) & (depth > 0)
    depth = np.where(valid, depth, np.nan)
    u = (np.arange(width) - camera.cx) / camera.fx
    v = (np.arange(height) - camera.cy) / camera.fy
    points = np.stack([depth * u[None], depth * v[:, None], depth], axis=-1)
    return points.astype(np.float32), valid


@dataclass(frozen=True)
class _Problem:
    """Least-squares problem f xy / (z + s) = uv of n points, with unknown focal length f and shift
    s.

    With p = xy / (z + s), the best f is (p . uv) / (p . p), and the sum of squares that it leaves
    is uv . uv - (p . uv)^2 / (p . p).

    Attributes:
        xy: (n, 2).
        z: (n,).
        uv: (n, 2).
    """

    xy: FloatArray
    z: FloatArray
    uv: FloatArray

    def lowest_shift(self) -> tuple[float, float]:
        """Return the shift that moves the nearest point to the camera, and a length scale of the
        points.

        A few points much nearer than all others are outliers and do not limit the shift.
        """
        low, middle = np.quantile(self.z, [0.01, 0.5])
        near = float(self.z[self.z >= low - 3 * (middle - low) - 1e-9 * abs(middle)].min())
        size = max(float(np.sqrt(np.mean(self.xy**2))), float(np.quantile(self.z, 0.99)) - near)
        if not size > 0:
            raise BackendError(
                "all points of the point map are the same: the network found no depth"
            )
        return -near, size

    def focal(self, shift: float) -> float:
        """Return the best focal length for a shift."""
        dot, square = self._sums(shift, 1, 2)
        return dot / square

    def error(self, shift: float) -> float:
        """Return the squared error with the best positive focal length, without the constant uv .
        uv.
        """
        dot, square = self._sums(shift, 1, 2)
        return -dot * abs(dot) / square

    def slope(self, shift: float) -> float:
        """Return a number with the sign of the derivative of :meth:`error`."""
        dot, square = self._sums(shift, 1, 2)
        dot_2, square_3 = self._sums(shift, 2, 3)
        return dot_2 * square - dot * square_3

    def error_at_1(self, shift: float) -> float:
        """Return the squared error with focal length 1, without the constant uv . uv."""
        dot, square = self._sums(shift, 1, 2)
        return square - 2 * dot

    def slope_at_1(self, shift: float) -> float:
        """Return half the derivative of :meth:`error_at_1`."""
        dot_2, square_3 = self._sums(shift, 2, 3)
        return dot_2 - square_3

    def uncertainty(self, shift: float) -> float:
        """Return the relative error of the points, divided by the relative variation of their
        distances.

        Points at equal distance only determine the ratio of focal length and distance. Errors as
        large as the variation have the same effect.
        """
        seen = self._in_front(shift)
        distance = self.z[seen] + shift
        fitted = self.focal(shift) * self.xy[seen] / distance[:, None]
        wrong = np.sqrt(np.mean((fitted - self.uv[seen]) ** 2) / np.mean(self.uv[seen] ** 2))
        relief = float(np.std(np.log(distance)))
        return float(wrong) / relief if relief > 1e-6 else float("inf")

    def _in_front(self, shift: float) -> BoolArray:
        """Return a mask of the points in front of the camera."""
        return self.z + shift > 0

    def _sums(self, shift: float, of_products: int, of_squares: int) -> tuple[float, float]:
        """Return the sums of uv . xy / (z + s)^k and of xy . xy / (z + s)^l over the points in
        front of the camera.
        """
        inverse = 1 / np.where(self._in_front(shift), self.z + shift, np.inf)
        products = (self.uv * self.xy).sum(1)
        squares = (self.xy**2).sum(1)
        return float(products @ inverse**of_products), float(squares @ inverse**of_squares)


def _minimise(
    error: Callable[[float], float],
    slope: Callable[[float], float],
    lowest: float,
    nearest: FloatArray,
) -> float:
    """Minimise ``error`` above ``lowest``: best point of a grid, then the zero of the slope near
    it.
    """
    from scipy.optimize import brentq

    errors = [error(lowest + d) for d in nearest]
    best = int(np.argmin(errors))
    low, high = (float(nearest[min(max(best + step, 0), len(nearest) - 1)]) for step in (-1, 1))
    if slope(lowest + low) < 0 < slope(lowest + high):
        return lowest + float(
            brentq(lambda d: slope(lowest + d), low, high, xtol=1e-15 * high, rtol=1e-14)
        )
    return lowest + float(nearest[best])


def _sampled(points: FloatArray, mask: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Sample (n, 3) valid points and their (n, 2) pixels, relative to the image centre in half
    diagonals.
    """
    height, width = mask.shape
    if points.shape != (height, width, 3):
        raise BackendError(
            f"a point map of {width} x {height} px must be ({height}, {width}, 3), got "
            f"{points.shape}"
        )
    rows = np.arange(min(height, _GRID)) * height // min(height, _GRID)
    columns = np.arange(min(width, _GRID)) * width // min(width, _GRID)
    v, u = (index.reshape(-1) for index in np.meshgrid(rows, columns, indexing="ij"))
    is_valid = mask[v, u] & np.isfinite(points[v, u]).all(-1)
    if is_valid.sum() < _MIN_SAMPLES:
        v, u = np.nonzero(mask & np.isfinite(points).all(-1))
        some = np.linspace(0, len(v) - 1, min(len(v), _GRID**2)).astype(int)
        v = v[some]
        u = u[some]
    else:
        v = v[is_valid]
        u = u[is_valid]
    if len(v) < 3:
        raise BackendError(
            f"the point map has {len(v)} valid points of {width} x {height}, too few for a camera: "
            "the network detects nothing in this photo"
        )
    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    uv = (np.stack([u, v], -1) - centre) / half_diagonal(height, width)
    return points[v, u].astype(np.float64), uv
