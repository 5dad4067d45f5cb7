"""Fit the floor as a plane in a disparity map of unknown focal length, scale and offset.

A plane n . X = h gives 1 / z = (n . r) / h with the ray r = (x, y, 1), and a disparity is affine in 1 / z: so every
plane of the scene is a plane over the pixels of the disparity map, whatever the camera and what the map leaves open.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.floating]
    BoolArray = NDArray[np.bool_]

_MAX_ROLL_DEG = 25.0
_MAX_LABELLED_ROLL_DEG = 50.0  # of a floor whose pixels are labelled
_LABELLED_SHARE = 0.02  # of the picture; a smaller labelled floor is ignored
_LABELLED_INLIERS = 0.4  # of the labelled pixels; a floor with fewer is looked for anywhere
_LOWER_SHARE = 0.6  # the floor is looked for in this lower part of the picture


@dataclass(frozen=True)
class DisparityFloor:
    """Plane of the floor in a disparity map: disparity = ``x * du + y * dv + d0``.

    x and y are relative to the principal point, in units of the photo's long side.

    Attributes:
        du: slope along x.
        dv: slope along y, positive: nearer further down.
        d0: value at the principal point.
        inlier_share: share of the lower part of the picture that lies on the plane.
        below_share: share of it that lies beyond the plane, where a floor cannot be seen through.
        value_range: 1st to 99th percentile of the disparity, the unit of every tolerance.
        candidate_share: share of the candidate pixels that lies on the plane.
    """

    du: float
    dv: float
    d0: float
    inlier_share: float
    below_share: float
    value_range: float
    candidate_share: float

    def horizon(self, infinity: float) -> float:
        """Return the image y of the floor's horizon at x = 0, from the principal point, in units of the long side."""
        return (infinity - self.d0) / self.dv

    def normal(self, infinity: float, focal: float) -> FloatArray:
        """Return the downward unit normal (3,) of the floor, camera frame.

        ``infinity`` is the disparity at infinity; ``focal`` is the focal length in units of the photo's long side.
        """

        down = np.array([self.du * focal, self.dv * focal, self.d0 - infinity])
        return np.asarray(down / np.linalg.norm(down))


def fit_disparity_floor(
    disparity: FloatArray,
    made_up: BoolArray | None = None,
    labelled: BoolArray | None = None,
    *,
    tolerance: float = 0.012,
    draws: int = 1500,
    seed: int = 0,
) -> DisparityFloor | None:
    """Fit the lowest large plane of a disparity map by RANSAC.

    Pixels nearer to the bottom count more, made-up ones less, and pixels that lie beyond the plane count against it:
    one does not see through a floor.

    Args:
        disparity: (H, W), larger is nearer.
        made_up: (H, W) bool, pixels that an inpainter invented.
        labelled: (H, W) bool, pixels of the floor by their look. They are the candidates, if they are enough and mostly
            lie on one plane; else the lower part of the picture is.
        tolerance: inlier band, in ranges of the disparity.
        draws: hypotheses of three pixels.
        seed: of the draws.

    Returns:
        The floor, or None where no draw looks like one.
    """
    if labelled is not None and labelled.mean() >= _LABELLED_SHARE:
        floor = _fit(disparity, made_up, labelled, tolerance, draws, seed)
        if floor is not None and floor.candidate_share >= _LABELLED_INLIERS:
            return floor
    return _fit(disparity, made_up, None, tolerance, draws, seed)


def _fit(
    disparity: FloatArray,
    made_up: BoolArray | None,
    labelled: BoolArray | None,
    tolerance: float,
    draws: int,
    seed: int,
) -> DisparityFloor | None:
    """Fit a plane to the labelled pixels, or to the lower part of the picture without any."""
    import cv2

    height, width = disparity.shape
    step = max(1, max(height, width) // 160)
    smooth = cv2.GaussianBlur(np.asarray(disparity, np.float32), (0, 0), step / 2)[::step, ::step].astype(np.float64)
    rows, columns = np.mgrid[0:height:step, 0:width:step]
    low = rows > (1 - _LOWER_SHARE) * (height - 1)
    candidate = low if labelled is None else labelled[::step, ::step]
    x = (columns - (width - 1) / 2) / max(height, width)
    y = (rows - (height - 1) / 2) / max(height, width)
    trust = 1 + rows / height
    if made_up is not None:
        trust = trust * np.where(made_up[::step, ::step], 0.3, 1.0)
    span = float(np.percentile(disparity, 99) - np.percentile(disparity, 1))
    if span <= 0 or candidate.sum() < 3:
        return None
    band = tolerance * span
    design = np.stack([x, y, np.ones_like(x)], -1)
    roll = _MAX_ROLL_DEG if labelled is None else _MAX_LABELLED_ROLL_DEG
    plane = _ransac(design[candidate], smooth[candidate], trust[candidate], band, (draws, seed, roll, 0.05 * span))
    if plane is None:
        return None
    rest = smooth - design @ plane
    du, dv, d0 = (float(p) for p in plane)
    on = np.abs(rest) < band
    return DisparityFloor(
        du, dv, d0, float(on[low].mean()), float((rest < -2 * band)[low].mean()), span, float(on[candidate].mean())
    )


def _ransac(
    design: FloatArray, value: FloatArray, trust: FloatArray, band: float, limits: tuple[int, int, float, float]
) -> FloatArray | None:
    """Fit a plane (3,) seen from above by RANSAC and least squares; None without one.

    Args:
        design: (M, 3) x, y, 1.
        value: (M,) disparities.
        trust: (M,) weights.
        band: largest error of an inlier.
        limits: hypotheses, seed, largest roll in degrees, least slope along y.
    """
    draws, seed, roll, least = limits
    rng = np.random.default_rng(seed)
    picked = rng.integers(0, len(value), (draws, 3))
    corners = design[picked]
    proper = np.abs(np.linalg.det(corners)) > 1e-4
    planes = np.linalg.solve(corners[proper], value[picked[proper]][..., None])[..., 0]
    level = np.abs(planes[:, 0]) < np.tan(np.radians(roll)) * planes[:, 1]
    planes = planes[(planes[:, 1] > least) & level]
    if not len(planes):
        return None
    scores = [trust @ _votes(value[:, None] - design @ chunk.T, band) for chunk in np.array_split(planes, 8)]
    plane = planes[int(np.concatenate(scores).argmax())]
    for _ in range(5):
        inside = np.abs(value - design @ plane) < band
        if inside.sum() < 3:
            return None
        root = np.sqrt(trust[inside])
        plane = np.linalg.lstsq(design[inside] * root[:, None], value[inside] * root, rcond=None)[0]
    return plane if plane[1] > 0 else None


def _votes(rest: FloatArray, band: float) -> FloatArray:
    """Return 1 for inliers of a plane, -1 for pixels clearly behind it, else 0."""
    return (abs(rest) < band).astype(float) - (rest < -2 * band)
