"""Bias between a backend's output and the truth, with its certainty: what a wrong backend has and a weak one has not.

A unit is one person or one photo. A mean over the units counts only beyond three standard errors, so that a network
with large errors passes where the errors point nowhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.conformance.expect import CheckSkipped, expect

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray

THREE_ERRORS = 0.99865
"""Probability below three standard errors; few units need more of them for it (Student's t distribution)."""

SURE_MARGINS, SURE_SHARE = 5.0, 0.1
"""A mean of this many margins counts from this share of its limit on: networks err that evenly only by a mistake."""

MIN_UNITS = 3
"""Units without which nothing is known of a bias."""

CLEARLY = 0.25
"""Mean of (own - other) / (own + other) of two errors above which the other one is clearly smaller: by two fifths."""

MIN_FOLLOWED = 0.25
"""Share of the true rotations that a pose has at least; a pose at rest has none of them."""

REACH_PX = 4
_BLUR_PX = 1.2


def mean_and_margin(values: FloatArray) -> tuple[float, float]:
    """Return the mean of the finite values (K,), and three of its standard errors.

    Raises:
        CheckSkipped: fewer than MIN_UNITS are finite.
    """
    from scipy.special import stdtrit

    known = np.asarray(values, np.float64)
    known = known[np.isfinite(known)]
    count = len(known)
    if count < MIN_UNITS:
        raise CheckSkipped(f"{count} people or photos to compare, {MIN_UNITS} are needed")
    return float(known.mean()), float(stdtrit(count - 1, THREE_ERRORS) * known.std(ddof=1) / np.sqrt(count))


def spread(errors: FloatArray) -> FloatArray:
    """Return the distance (K,) of each error from the mean of the others."""
    distance: FloatArray = np.abs(errors - errors.mean()) * len(errors) / max(len(errors) - 1, 1)
    return distance


def expect_no_bias(
    values: FloatArray, limit: float, expected: str, unit: str = "", hint: str = "", *, further: float = 0.0
) -> None:
    """Raise CheckFailed if the mean of the values (K,) is beyond +-limit by more than its margin, or surely not zero.

    Args:
        values: error of each unit; NaN where there is none.
        limit: largest mean that is treated as zero.
        expected: what the contract requires.
        unit: of the values.
        hint: likely cause.
        further: another margin of the mean, if larger.

    Raises:
        CheckSkipped: too few values.
    """
    mean, margin = mean_and_margin(values)
    margin = max(margin, further)
    is_sure = abs(mean) > SURE_SHARE * limit and abs(mean) > SURE_MARGINS * margin
    expect(
        abs(mean) - margin <= limit and not is_sure,
        expected,
        f"{mean:+.3g}{unit} in the mean, with three standard errors of {margin:.2g}{unit}",
        hint,
    )


def expect_no_better(
    own: FloatArray,
    others: Mapping[str, FloatArray],
    negligible: float,
    expected: str,
    hints: Mapping[str, str] | None = None,
    *,
    clearly: float = CLEARLY,
) -> None:
    """Raise CheckFailed if another reading of the output is clearly closer to the truth.

    Each unit counts by (own - other) / (own + other), so that all count alike: 1 where the other error is zero. Units
    that both readings fit equally, such as symmetric ones, do not count.

    Args:
        own: error of each unit (K,) as the output is.
        others: words for the other reading -> error of each unit (K,).
        negligible: error that is treated as zero.
        expected: what the contract requires, with the unit of the errors.
        hints: words for the other reading -> likely cause.
        clearly: mean above which the other reading is clearly closer.

    Raises:
        CheckSkipped: too few units have an error.
    """
    mean_and_margin(own)
    for words, other in sorted(others.items(), key=lambda item: float(np.nanmean(item[1]))):
        differ = np.abs(own - other) > negligible
        if differ.sum() < MIN_UNITS:
            continue
        own_errors, others_errors = own[differ], other[differ]
        mean, margin = mean_and_margin((own_errors - others_errors) / (own_errors + others_errors + negligible))
        expect(
            mean - margin <= clearly,
            expected,
            f"an error of {own_errors.mean():.3g} as it is, but of {others_errors.mean():.3g} if it is {words}",
            (hints or {}).get(words, ""),
        )


def expect_follows(poses: Sequence[FloatArray], truth: Sequence[FloatArray], name: str) -> None:
    """Raise CheckFailed if rotation vectors (J, 3) of each unit have little to do with the true ones.

    Raises:
        CheckSkipped: too few units.
    """
    shares = [float((p * t).sum() / max(float((t * t).sum()), 1e-9)) for p, t in zip(poses, truth, strict=True)]
    mean, margin = mean_and_margin(np.array(shares))
    expect(
        mean + margin >= MIN_FOLLOWED,
        f"{name} that bends as people in the photo do",
        f"rotations that have {mean:.0%} of the true ones in the mean, with three standard errors of {margin:.0%}",
        "Is it a pose at rest for every photo, or are the angles in another unit or order?",
    )


def expect_order(apart: FloatArray, names: Sequence[str], negligible: float, expected: str, hint: str = "") -> None:
    """Raise CheckFailed if the rows of the output fit the truth clearly better in another order.

    Args:
        apart: (K, J, J) distance of the output's row j from the truth's row k in each unit; NaN where unknown.
        names: of the J rows.
        negligible: distance that is treated as zero.
        expected: what the contract requires.
        hint: likely cause.

    Raises:
        CheckSkipped: too few units show the rows that would change places.
    """
    from scipy.optimize import linear_sum_assignment

    known = np.isfinite(apart)
    cost = np.where(known, apart, 0).sum(0) / np.maximum(known.sum(0), 1)
    best = linear_sum_assignment(np.where(known.sum(0) < MIN_UNITS, np.nanmax(cost, initial=1.0) * 10, cost))[1]
    moved = np.flatnonzero(best != np.arange(len(names)))
    if not len(moved):
        return
    own, other = apart[:, moved, moved], apart[:, moved, best[moved]]
    both = np.isfinite(own) & np.isfinite(other)
    own, other = (np.where(both, v, 0).sum(1) / np.where(both.any(1), both.sum(1), np.nan) for v in (own, other))
    pairs = ", ".join(f"{names[j]} for {names[best[j]]}" for j in moved[:4])
    expect_no_better(own, {f"reordered: {pairs}": other}, negligible, expected, {f"reordered: {pairs}": hint})


def pixel_shift(values: FloatArray, truth: FloatArray, known: BoolArray, *, edges: bool = True) -> FloatArray:
    """Return the shift (2,) of an image against the truth along x and y, px; NaN where it shows none.

    Args:
        values: (H, W) output.
        truth: (H, W).
        known: (H, W) bool, pixels to compare.
        edges: compare slopes, which errors of low frequency leave as they are; else the values.
    """
    import cv2

    found = np.full(2, np.nan)
    weight = known.astype(np.float64)
    inner = known
    if edges:
        inner = np.asarray(cv2.erode(known.astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=0)).astype(bool)
    pictures = [np.where(np.isfinite(v), v, 0.0) * weight for v in (values, truth)]
    spread = np.maximum(cv2.GaussianBlur(weight, (0, 0), _BLUR_PX), 1e-6)
    smooth = [cv2.GaussianBlur(p, (0, 0), _BLUR_PX) / spread for p in pictures]
    for i, axis in enumerate((1, 0)):
        own, true = (np.gradient(p, axis=axis) if edges else p for p in smooth)
        fits = []
        for step in range(-REACH_PX, REACH_PX + 1):
            both = inner & np.roll(inner, step, axis)
            both[_border(axis, step)] = False
            a, b = own[both], np.roll(true, step, axis)[both]
            if edges:
                fits.append(float((a * b).sum() / max(np.sqrt((a * a).sum() * (b * b).sum()), 1e-12)))
            else:
                fits.append(-float(np.abs(a - b).mean()) if len(a) else 0.0)
        best = int(np.argmax(fits))
        if max(fits) - min(fits) > 1e-6:
            found[i] = best - REACH_PX + _peak(fits, best)
    return found


def _border(axis: int, step: int) -> tuple[slice, slice]:
    """Return the slices of the pixels that ``np.roll`` moved across the border."""
    rolled = slice(0, step) if step > 0 else slice(step, None) if step < 0 else slice(0, 0)
    return (slice(None), rolled) if axis == 1 else (rolled, slice(None))


def _peak(fits: list[float], best: int) -> float:
    """Return the peak of the parabola through the best value and its neighbours, relative to the best, in [-.5, .5]."""
    if not 0 < best < len(fits) - 1:
        return 0.0
    before, at, after = fits[best - 1 : best + 2]
    bend = before - 2 * at + after
    return 0.5 * (before - after) / bend if bend < 0 else 0.0
