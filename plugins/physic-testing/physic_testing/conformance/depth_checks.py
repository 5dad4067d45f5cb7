"""Comparison of a depth map with the true depth: rank correlation, orientation, unit and ambiguity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, get_args

import numpy as np

from physic_core.types import AffineAmbiguity
from physic_testing.conformance.bias import expect_no_better, expect_no_bias, pixel_shift
from physic_testing.conformance.expect import CheckSkipped, expect

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray, Intrinsics
    from physic_testing.conformance.cases import Case

MAX_SHIFT_PX, MAX_CENTRE_PX, MAX_ASPECT, MAX_FOCAL = 0.5, 0.3, 2.0, 30.0
"""Mean shift of edges, and mean errors of principal point, fx / fy and focal length in %, that are treated as zero."""

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


def expect_ambiguity(answers: Sequence[tuple[Case, FloatArray, AffineAmbiguity]], clearly: float) -> None:
    """Raise CheckFailed if depth maps (H, W) fit the truth better after a fit of another scale and shift.

    Args:
        answers: photo, depth in any unit with NaN where unknown, and the ambiguity that its backend states.
        clearly: as of :func:`physic_testing.conformance.bias.expect_no_better`.
    """
    stated = answers[0][2]
    errors = {
        kind: np.array([aligned_depth_error(z, case.truth.empty_depth, kind) for case, z, _ in answers])
        for kind in get_args(AffineAmbiguity)
    }
    words = {f"fitted by {kind!r}": found for kind, found in errors.items() if kind != stated}
    expect_no_better(
        errors[stated],
        words,
        0.0001,
        f"agreement with the truth after a fit of {stated!r}, relative error of depth",
        {name: f"Return unknown={name.split()[-1]}, or remove the offset." for name in words},
        clearly=clearly,
    )


def aligned_depth_error(z: FloatArray, truth: FloatArray, unknown: AffineAmbiguity) -> float:
    """Return the median relative depth error after a robust fit of the unknown scale and shift; NaN without pixels."""
    both = np.isfinite(z) & np.isfinite(truth) & (z > 0) & (truth > 0)
    if both.sum() < 16:
        return float("nan")
    return float(np.median(_fit(z[both].astype(np.float64), truth[both].astype(np.float64), unknown)[1]))


def expect_not_shifted(answers: Sequence[tuple[Case, FloatArray, AffineAmbiguity]]) -> None:
    """Raise CheckFailed if the edges of depth maps (H, W) have a common shift against the true ones."""
    shifts = []
    for case, z, unknown in answers:
        truth = case.truth.empty_depth
        both = np.isfinite(z) & np.isfinite(truth) & (z > 0)
        ratio = _fit(z[both].astype(np.float64), truth[both].astype(np.float64), unknown)[0]
        logs = np.zeros((2, *truth.shape))
        logs[:, both] = np.log(np.maximum(ratio, 1e-3) * truth[both]), np.log(truth[both])
        shifts.append(pixel_shift(logs[0], logs[1], both & ~case.hole))
    for axis, way in enumerate("xy"):
        expect_no_bias(
            np.array(shifts)[:, axis],
            MAX_SHIFT_PX,
            f"edges of depth in place along {way}",
            " px",
            "Is the padding of the network's input subtracted, and the output resized by pixel centres?",
        )


def _fit(own: FloatArray, true: FloatArray, unknown: AffineAmbiguity) -> tuple[FloatArray, FloatArray]:
    """Fit the unknown scale and shift of depths (M,) robustly; return fitted over true depth, and the residual."""
    # Each row: fitted depth / true depth = 1, in the space in which the unknowns are linear.
    columns: dict[str, list[FloatArray]] = {
        "scale": [own / true],
        "scale_shift": [own / true, 1 / true],
        "inverse_scale_shift": [true / own, true],
    }
    design = np.stack(columns[unknown], axis=1)
    weight = np.ones(len(own))
    residual = fitted = np.zeros(len(own))
    for _ in range(_ROUNDS):
        found = np.linalg.lstsq(design * weight[:, None], weight, rcond=None)[0]
        fitted = design @ found
        residual = np.abs(fitted - 1)
        weight = 1 / np.sqrt(1 + (residual / (2 * np.median(residual) + 1e-9)) ** 2)
    return 1 / np.maximum(fitted, 1e-3) if unknown == "inverse_scale_shift" else fitted, residual


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
    as_z, as_ray = (aligned_depth_error(z, true, unknown) for true in (truth, truth * stretch))
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


def expect_camera_without_bias(cameras: Sequence[tuple[Intrinsics | None, Intrinsics]]) -> None:
    """Raise CheckFailed if returned cameras have a common error of principal point, aspect ratio or focal length."""
    known = [(camera, truth) for camera, truth in cameras if camera is not None]
    if not known:
        raise CheckSkipped("it returns no intrinsics")
    for name in ("cx", "cy"):
        expect_no_bias(
            np.array([getattr(camera, name) - getattr(truth, name) for camera, truth in known]),
            MAX_CENTRE_PX,
            f"{name} in px from the centre of the first pixel",
            " px",
            "The centre of an image W px wide is (W - 1) / 2: integer coordinates are pixel centres.",
        )
    expect_no_bias(
        np.array([100 * np.log(camera.fx / camera.fy * truth.fy / truth.fx) for camera, truth in known]),
        MAX_ASPECT,
        "fx over fy of the photo",
        " %",
        "Was the photo resized to another aspect ratio?",
    )
    expect_no_bias(
        np.array([50 * np.log(camera.fx / truth.fx * camera.fy / truth.fy) for camera, truth in known]),
        MAX_FOCAL,
        "the focal length of the photo",
        " %",
        "Is it in px of the network's input, or of another camera than that of the depth?",
    )


def _resampled(values: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Resample an array to another shape, nearest neighbour."""
    rows: NDArray[np.int64] = (np.arange(shape[0]) + 0.5) * values.shape[0] // shape[0]
    columns: NDArray[np.int64] = (np.arange(shape[1]) + 0.5) * values.shape[1] // shape[1]
    taken: FloatArray = values[np.ix_(rows.astype(int), columns.astype(int))]
    return taken
