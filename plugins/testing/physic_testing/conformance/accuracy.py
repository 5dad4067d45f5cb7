"""Errors of backends on worlds, which are limited for perfect networks alone."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from physic_testing.conformance.expect import CheckSkipped, expect

if TYPE_CHECKING:
    from physic_core.types import AffineAmbiguity, BoolArray, FloatArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case
    from physic_testing.conformance.known_mistakes import Table

SKY_BORDER_PX = 3
"""Distance from the sky up to which depths are not compared."""


LIMITS = {
    "IoU": 0.99,
    "PSNR in the hole, dB": 40.0,
    "abs-rel": 0.01,
    "abs-rel, aligned": 0.01,
    "share of person": 0.002,
    "MPJPE, mm": 5.0,
    "degrees": 1.0,
    "Brier": 0.01,
    "F1": 0.99,
}
"""Error name, with its unit -> worst value in a photo of a backend with the capability "exact"."""

_HIGHER_IS_BETTER = ("IoU", "PSNR in the hole, dB", "F1")


def measure_errors(table: Table | None, answer: Any, case: Case) -> dict[str, float]:
    """Measure the errors of one result against the ground truth.

    Args:
        table: table of the interface of the backend.
        answer: valid result of the backend.
        case: photo with ground truth.

    Returns:
        Error name -> value; the error by which two results are compared first.

    Raises:
        CheckSkipped: worlds have no ground truth for this interface.
    """
    if table is None:
        raise CheckSkipped("worlds have no ground truth for this interface")
    errors = table.errors(*table.compared(answer, case))
    return {
        name: float(np.nanmean(v)) if np.isfinite(v).any() else np.nan for name, v in errors.items()
    }


def main_error(table: Table | None, answer: Any, case: Case) -> tuple[str, float]:
    """Return the name of the error by which results are compared, and its value, turned such that
    lower is better; NaN if it was not measured.

    Raises:
        CheckSkipped: worlds have no ground truth for this interface.
        BodyModelError: the result is of a body that cannot be compared.
    """
    name, value = next(iter(measure_errors(table, answer, case).items()))
    return name, 1 - value if name in _HIGHER_IS_BETTER else value


def check_is_exact(subject: BackendUnderTest) -> None:
    """The output is the truth in all photos of people, as the capability "exact" declares."""
    for case, answer in subject.evidence():
        for name, value in measure_errors(subject.table, answer, case).items():
            sign = -1 if name in _HIGHER_IS_BETTER else 1
            limit = LIMITS.get(name, np.nan)
            expect(
                not sign * value > sign * limit,
                f"{name} of {limit:g} or better in all photos, as of a perfect network",
                f"{value:.3g} in the photo '{case.name}'",
                "Is it a factor, a shift, another order, a border, or resampling? If only some "
                "photos are wrong: is a photo of this shape turned back as it was turned?",
            )


def inner_pixels(mask: BoolArray) -> BoolArray:
    """Return the pixels of a mask (H, W) that are not within SKY_BORDER_PX of its border, where
    resampling mixes depths.
    """
    import cv2

    brush = np.ones((2 * SKY_BORDER_PX + 1,) * 2, np.uint8)
    inner: BoolArray = cv2.erode(mask.astype(np.uint8), brush, borderValue=1) > 0
    return inner


_ROUNDS = 8
_FITTED = 2000  # pixels of a photo that take part in a fit


def fit_ambiguity(z: FloatArray, truth: FloatArray, unknown: AffineAmbiguity) -> FloatArray:
    """Fit the unknown scale and shift of depths (M,) robustly; return fitted over true depth."""
    z, truth = (side.astype(np.float64) for side in (z, truth))
    # Each row: fitted depth / true depth = 1, in the space in which the unknowns are linear.
    columns = {
        "scale": [z / truth],
        "scale_shift": [z / truth, 1 / truth],
        "inverse_scale_shift": [truth / z, truth],
    }
    every = np.stack(columns[unknown], axis=1)
    design = every[:: max(1, len(z) // _FITTED)]
    weight = np.ones(len(design))
    for _ in range(_ROUNDS):
        solution = np.linalg.lstsq(design * weight[:, None], weight, rcond=None)[0]
        residual = np.abs(design @ solution - 1)
        weight = 1 / np.sqrt(1 + (residual / (2 * np.median(residual) + 1e-9)) ** 2)
    fitted: FloatArray = every @ solution
    return 1 / np.maximum(fitted, 1e-3) if unknown == "inverse_scale_shift" else fitted
