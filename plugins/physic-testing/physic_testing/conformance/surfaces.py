"""Depth against true depth: which order, which way up, and how far off under each kind of unknown."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_testing.conformance.expect import CheckSkipped, expect

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import AffineAmbiguity, BoolArray, FloatArray, Intrinsics

__all__ = [
    "aligned_error",
    "expect_along_z",
    "expect_camera_of_photo",
    "expect_cover",
    "expect_farther_is_larger",
    "expect_lies_like_photo",
    "order_agreement",
]

LEAST_COVER = 0.3
"""Share of the photo of which something must be known."""

_ROUNDS = 8


def order_agreement(first: FloatArray, second: FloatArray) -> float:
    """Rank correlation of two depth maps (H, W) where both are finite: 1 same order, -1 opposite."""
    from scipy.stats import rankdata

    both = np.isfinite(first) & np.isfinite(second)
    if both.sum() < 16:
        return 0.0
    a, b = rankdata(first[both]), rankdata(second[both])
    spread = float(a.std() * b.std())
    return float(((a - a.mean()) * (b - b.mean())).mean()) / spread if spread > 0 else 0.0


def aligned_error(z: FloatArray, truth: FloatArray, unknown: AffineAmbiguity) -> float:
    """Median share of the true depth that remains when what is unknown has been fitted; inf if nothing is common.

    Args:
        z: (H, W) any unit, NaN where unknown.
        truth: (H, W) metres.
        unknown: what may be fitted.
    """
    both = np.isfinite(z) & np.isfinite(truth) & (z > 0) & (truth > 0)
    if both.sum() < 16:
        return float("inf")
    own, true = z[both].astype(np.float64), truth[both].astype(np.float64)
    # Each row says: fitted depth over true depth is 1, in the space where the unknowns are linear.
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


def expect_cover(known: BoolArray) -> None:
    """Enough pixels are known."""
    share = float(known.mean())
    expect(
        share >= LEAST_COVER,
        f"a depth for at least {LEAST_COVER:.0%} of the pixels of a plain room",
        f"{share:.0%}",
    )


def expect_lies_like_photo(z: FloatArray, truth: FloatArray) -> None:
    """No turned or mirrored version of the depth fits the photo better."""
    agreement = order_agreement(z, truth)
    others = {
        "transposed": _resampled(z.T, truth.shape),
        "mirrored left to right": z[:, ::-1],
        "upside down": z[::-1],
        "turned by half a turn": z[::-1, ::-1],
    }
    best = max(others, key=lambda name: order_agreement(others[name], truth))
    other = order_agreement(others[best], truth)
    expect(
        other < max(agreement + 0.15, 0.6),
        "depth in the photo's own rows and columns",
        f"a rank correlation of {agreement:.2f} with the true depth, but of {other:.2f} if the answer is {best}",
        "Do the axes come out as (H, W)?",
    )


def expect_farther_is_larger(z: FloatArray, truth: FloatArray) -> None:
    """What is farther has the larger number."""
    agreement = order_agreement(z, truth)
    expect(
        agreement > -0.3,
        "larger numbers for what is farther away",
        f"a rank correlation of {agreement:.2f} with the true depth",
        "Is it disparity, 1 / z?",
    )


def expect_along_z(z: FloatArray, truth: FloatArray, camera: Intrinsics, unknown: AffineAmbiguity) -> None:
    """The numbers are depth along the optical axis, not length along the ray."""
    rows, columns = np.mgrid[: truth.shape[0], : truth.shape[1]]
    stretch = np.sqrt(1 + ((columns - camera.cx) / camera.fx) ** 2 + ((rows - camera.cy) / camera.fy) ** 2)
    as_z, as_ray = aligned_error(z, truth, unknown), aligned_error(z, truth * stretch, unknown)
    if not np.isfinite(as_z):
        raise CheckSkipped("no depth is known")
    expect(
        as_z < 0.005 or as_ray > 0.5 * as_z,
        "depth along the optical axis, z",
        f"{as_z:.1%} off the true z but only {as_ray:.1%} off the true length of the rays",
        "Divide by sqrt(1 + ((u - cx) / fx)^2 + ((v - cy) / fy)^2).",
    )


def expect_camera_of_photo(camera: Intrinsics | None, truth: Intrinsics) -> None:
    """A camera that a backend answers is one of this photo, in its pixels."""
    if camera is None:
        raise CheckSkipped("it answers no camera")
    low, high = truth.fx / 4, 4 * truth.fx
    expect(
        low < camera.fx < high and low < camera.fy < high,
        f"a focal length in px, within a factor 4 of the true {truth.fx:.0f} px",
        f"{camera.fx:.4g} and {camera.fy:.4g}",
        "Is it in shares of the width, in mm, or an angle?",
    )
    inside = 0 < camera.cx < truth.width and 0 < camera.cy < truth.height
    expect(inside, "a principal point in the photo, px", f"({camera.cx:.4g}, {camera.cy:.4g})")


def _resampled(values: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    rows: NDArray[np.int64] = (np.arange(shape[0]) + 0.5) * values.shape[0] // shape[0]
    columns: NDArray[np.int64] = (np.arange(shape[1]) + 0.5) * values.shape[1] // shape[1]
    taken: FloatArray = values[np.ix_(rows.astype(int), columns.astype(int))]
    return taken
