"""Comparison of a depth map with the true depth: rank correlation, orientation, unit and ambiguity."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_testing.conformance.expect import CheckSkipped, expect

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import AffineAmbiguity, BoolArray, FloatArray, Intrinsics

__all__ = [
    "aligned_depth_error",
    "expect_along_z",
    "expect_camera_of_photo",
    "expect_coverage",
    "expect_depth_grows_with_distance",
    "expect_not_flipped",
    "rank_correlation",
]

MIN_COVERAGE = 0.3
"""Minimum share of pixels with known depth."""

_ROUNDS = 8


def rank_correlation(first: FloatArray, second: FloatArray) -> float:
    """Return the rank correlation of two depth maps (H, W) over their finite pixels: 1 same order, -1 opposite."""
    from scipy.stats import rankdata

    both = np.isfinite(first) & np.isfinite(second)
    if both.sum() < 16:
        return 0.0
    a, b = rankdata(first[both]), rankdata(second[both])
    spread = float(a.std() * b.std())
    return float(((a - a.mean()) * (b - b.mean())).mean()) / spread if spread > 0 else 0.0


def aligned_depth_error(z: FloatArray, truth: FloatArray, unknown: AffineAmbiguity) -> float:
    """Return the median relative depth error after a robust fit of the unknown scale and shift.

    The error is inf without common pixels.

    Args:
        z: (H, W) depth in any unit, NaN where unknown.
        truth: (H, W) true depth, m.
        unknown: ambiguity that is fitted.
    """
    both = np.isfinite(z) & np.isfinite(truth) & (z > 0) & (truth > 0)
    if both.sum() < 16:
        return float("inf")
    own, true = z[both].astype(np.float64), truth[both].astype(np.float64)
    # Each row: fitted depth / true depth = 1, in the space in which the unknowns are linear.
    columns = {
        "scale": [own / true],
        "scale_shift": [own / true, 1 / true],
        "inverse_scale_shift": [true / own, true],
    }[unknown]
    design = np.stack(columns, axis=1)
    weight = np.ones(len(own))
    residual = np.zeros(len(own))
    for _ in range(_ROUNDS):
        found = np.linalg.lstsq(design * weight[:, None], weight, rcond=None)[0]
        residual = np.abs(design @ found - 1)
        weight = 1 / np.sqrt(1 + (residual / (2 * np.median(residual) + 1e-9)) ** 2)
    return float(np.median(residual))


def expect_coverage(known: BoolArray) -> None:
    """Raise CheckFailed if too few pixels have a known depth."""
    share = float(known.mean())
    expect(
        share >= MIN_COVERAGE,
        f"known depth in at least {MIN_COVERAGE:.0%} of the pixels",
        f"{share:.0%}",
    )


def expect_not_flipped(z: FloatArray, truth: FloatArray) -> None:
    """Raise CheckFailed if a transposed, mirrored or rotated depth map fits the truth better."""
    agreement = rank_correlation(z, truth)
    others = {
        "transposed": _resampled(z.T, truth.shape),
        "mirrored left to right": z[:, ::-1],
        "upside down": z[::-1],
        "rotated by 180 degrees": z[::-1, ::-1],
    }
    best = max(others, key=lambda name: rank_correlation(others[name], truth))
    other = rank_correlation(others[best], truth)
    expect(
        other < max(agreement + 0.15, 0.6),
        "depth in the rows and columns of the photo",
        f"a rank correlation of {agreement:.2f} with the true depth, but {other:.2f} if the output is {best}",
        "Is the shape (H, W)?",
    )


def expect_depth_grows_with_distance(z: FloatArray, truth: FloatArray) -> None:
    """Raise CheckFailed if the order of the depths is opposite to that of the true depths."""
    agreement = rank_correlation(z, truth)
    expect(
        agreement > -0.3,
        "larger values for farther points",
        f"a rank correlation of {agreement:.2f} with the true depth",
        "Is it disparity, 1 / z?",
    )


def expect_along_z(z: FloatArray, truth: FloatArray, camera: Intrinsics, unknown: AffineAmbiguity) -> None:
    """Raise CheckFailed if the values fit the ray length better than the depth along the optical axis."""
    rows, columns = np.mgrid[: truth.shape[0], : truth.shape[1]]
    stretch = np.sqrt(1 + ((columns - camera.cx) / camera.fx) ** 2 + ((rows - camera.cy) / camera.fy) ** 2)
    as_z, as_ray = aligned_depth_error(z, truth, unknown), aligned_depth_error(z, truth * stretch, unknown)
    if not np.isfinite(as_z):
        raise CheckSkipped("no depth is known")
    expect(
        as_z < 0.005 or as_ray > 0.5 * as_z,
        "depth along the optical axis, z",
        f"{as_z:.1%} off the true z but only {as_ray:.1%} off the true length of the rays",
        "Divide by sqrt(1 + ((u - cx) / fx)^2 + ((v - cy) / fy)^2).",
    )


def expect_camera_of_photo(camera: Intrinsics | None, truth: Intrinsics) -> None:
    """Raise CheckFailed if the returned intrinsics are not in pixels of this photo."""
    if camera is None:
        raise CheckSkipped("it returns no intrinsics")
    low, high = truth.fx / 4, 4 * truth.fx
    expect(
        low < camera.fx < high and low < camera.fy < high,
        f"a focal length in px, within a factor 4 of the true {truth.fx:.0f} px",
        f"{camera.fx:.4g} and {camera.fy:.4g}",
        "Is it a share of the width, in mm, or an angle?",
    )
    inside = 0 < camera.cx < truth.width and 0 < camera.cy < truth.height
    expect(inside, "a principal point inside the photo, px", f"({camera.cx:.4g}, {camera.cy:.4g})")


def _resampled(values: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Resample an array to another shape, nearest neighbour."""
    rows: NDArray[np.int64] = (np.arange(shape[0]) + 0.5) * values.shape[0] // shape[0]
    columns: NDArray[np.int64] = (np.arange(shape[1]) + 0.5) * values.shape[1] // shape[1]
    taken: FloatArray = values[np.ix_(rows.astype(int), columns.astype(int))]
    return taken
