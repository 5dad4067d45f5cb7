"""Readings: what known mistakes make of the truth, and whether an output is one of them.

An output is compared as a vector for each unit, a person or a photo. A mistake puts it off by a
known vector. The share of that vector in what it is off by is 1 with the mistake and 0 without it.
A mistake counts if most units show it in the same direction. The row ::

    Reading("down", shifted(axis=0), "Is the padding subtracted?", size=1, unit=" px", limit=0.5)

fails outputs that most photos show to be moved down by more than half a pixel, and says by how
much.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from physic_core.interfaces.comparison import is_sigmoid_of_probability
from physic_testing.conformance.check import BLIND, Check
from physic_testing.conformance.expect import CheckFailed, CheckSkipped, expect

if TYPE_CHECKING:
    from physic_core.types import FloatArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case, Truth, Values

Make: TypeAlias = "Callable[[Any, Truth], Any]"
"""Value of the truth, and the whole truth -> the value with a mistake."""

VectorsOf: TypeAlias = "Callable[[Any, Truth], Iterable[FloatArray]]"
"""A value, and the whole truth -> a vector for each unit, NaN where unknown."""

ValuesOf: TypeAlias = "Callable[[Any, Case], tuple[Values, Truth]]"
"""Output and photo -> values of the output, and of the truth without ``case``."""

MIN_UNITS = 3
"""Units without which nothing is known of a bias."""

MADE = 0.6
MADE_ONCE = 1.5
"""Shares between which a mistake is made; it is a half of an output that ignores the photo."""

AGREE = 0.8
"""Share of the units that must show a mistake in the same direction."""

EXPLAINS = 0.97
"""Largest share of the squared error that is left if most mistakes are undone."""

MAX_SIGMAS = 3.0
"""Stated standard deviations within which the median of errors lies."""

_FLAT = 1e-6
_CONSTANT = 0.05  # share of the variance of the truth
_TELLING = 0.02  # share of the largest mistake from which on a unit shows it


@dataclass(frozen=True)
class KnownMistake:
    """What a known mistake makes of the truth.

    Attributes:
        words: end of the sentence "the output is ...".
        make: makes the mistake.
        hint: likely cause.
        size: of a mistake that has any size, how large that of ``make`` is; 0 if it is made or not.
        unit: of the size.
        limit: largest size that is treated as zero, or the share from which on a mistake without a
            size is made.
        left: largest share of the squared error that is left if the mistake is undone.
        shows_when_blind: whether an output that ignores the image can show it, too.
    """

    words: str
    make: Make
    hint: str = ""
    size: float = 0.0
    unit: str = ""
    limit: float = MADE
    left: float = EXPLAINS
    shows_when_blind: bool = False


def plus(*numbers: float) -> Make:
    """Return the ``make`` of a reading that adds numbers along the last axis."""
    return lambda value, _: value + np.array(numbers)


def times(*numbers: float) -> Make:
    """Return the ``make`` of a reading that multiplies by numbers along the last axis."""
    return lambda value, _: value * np.array(numbers)


def shifted(axis: int) -> Make:
    """Return the ``make`` of a reading that moves an image by a pixel along an axis, to first
    order.
    """
    return lambda image, _: image - np.gradient(image, axis=axis)


def flipped(axis: int) -> Make:
    """Return the ``make`` of a reading that reverses an axis."""
    return lambda value, _: np.flip(value, axis)


def reordered(order: Sequence[int], axis: int = 1) -> Make:
    """Return the ``make`` of a reading that takes parts along an axis in another order."""
    return lambda value, _: np.take(value, order, axis)


def rows(value: Any, truth: Truth) -> list[FloatArray]:
    """Return each row of a value as the vector of a unit."""
    return [row.ravel() for row in value]


def normalised(value: Any, truth: Truth) -> list[FloatArray]:
    """Return the rows with mean 0 and length 1, NaN where a row is constant: the order of its
    numbers counts, and no level.
    """
    flat = value - value.mean(axis=1, keepdims=True)
    length = np.linalg.norm(flat, axis=1, keepdims=True)
    return list(np.where(length > _FLAT, flat / np.maximum(length, _FLAT), np.nan))


@dataclass(frozen=True)
class Group:
    """What one check compares.

    Attributes:
        check: name of the check.
        what: what the contract requires.
        key: name of the value that is compared.
        unit: of the errors.
        readings: other readings of the output.
        vectors: what is compared of the value.
        centred: only differences between the units count.
        rough: largest median error over the units.
        search: returns the reading that fits the outputs best, of a kind that has too many to
            list; see :func:`search_order`.
        is_telling: the value is a probability, which differs between photos.
        after: names of further checks that come first.
    """

    check: str
    what: str
    key: str
    unit: str
    readings: tuple[KnownMistake, ...]
    vectors: VectorsOf = rows
    centred: bool = False
    rough: float = float("inf")
    search: Callable[[str, Sequence[tuple[Values, Truth]]], list[KnownMistake]] | None = None
    is_telling: bool = False
    after: tuple[str, ...] = ()


@dataclass(frozen=True)
class Table:
    """What is checked of the outputs of one interface, in order of execution.

    Attributes:
        values: values of an output and of the truth.
        errors: values of an output and of the truth -> name of each error -> numbers whose mean it
            is, the one by which two results are compared first.
        checks: checks that are no comparison with known mistakes.
        groups: comparisons with known mistakes.
        after: names of checks that come before the comparisons.
    """

    values: ValuesOf
    errors: Callable[[Values, Truth], dict[str, Any]]
    checks: tuple[Check, ...]
    groups: tuple[Group, ...]
    after: tuple[str, ...] = ()

    def compared(self, answer: Any, case: Case) -> tuple[Values, Truth]:
        """Return the values of an output and the whole truth of its photo."""
        values, truth = self.values(answer, case)
        return values, truth | {"case": case}


def values_of(subject: BackendUnderTest) -> list[tuple[Values, Truth]]:
    """Return the values of output and truth of the photos of people; the first call computes
    them.
    """
    if not subject.values and subject.table is not None:
        subject.values = [subject.table.compared(out, case) for case, out in subject.evidence()]
    return subject.values


def check_of(table: Table, group: Group) -> Check:
    """Return the check of a group."""

    def function(subject: BackendUnderTest) -> None:
        compare(subject, group)

    function.__name__ = f"check_{group.check}"
    function.__doc__ = f"{group.what}."
    return Check(function, after=(*table.after, *group.after))


def compare(subject: BackendUnderTest, group: Group) -> None:
    """Raise CheckFailed if outputs are one of the readings of a group.

    Raises:
        CheckSkipped: too few photos have a valid output.
    """
    evidence = values_of(subject)
    is_blind = bool(BLIND & subject.declared)
    if group.is_telling and not is_blind:
        expect_telling(np.concatenate([v[group.key].ravel() for v, _ in evidence]), group.what)
    true = _unit_vectors(group, [(truth[group.key], truth) for _, truth in evidence])
    answered = _unit_vectors(group, [(values[group.key], truth) for values, truth in evidence])
    differences = _differences(answered, true)
    finite = [unit for unit in differences if np.isfinite(unit).any()]
    if len(finite) < MIN_UNITS:
        raise CheckSkipped(f"{len(finite)} people or photos to compare, {MIN_UNITS} are needed")
    readings = [*group.readings, *(group.search(group.key, evidence) if group.search else ())]
    candidates = []
    for reading in [] if _is_constant(answered, true) else readings:
        if reading.shows_when_blind or not is_blind:
            pairs = [(reading.make(truth[group.key], truth), truth) for _, truth in evidence]
            share, left = _mistake_share_and_rest(
                group, reading, differences, _differences(_unit_vectors(group, pairs), true)
            )
            if share and left < reading.left:
                candidates.append((left, share, reading))
    rough = float(np.median([np.sqrt(np.nanmean(unit**2)) for unit in finite]))
    words = f"an error of {rough:.3g} {group.unit} in the median"
    if candidates:
        _, share, reading = min(candidates, key=lambda item: item[0])
        size = f"{share * reading.size:+.3g}{reading.unit} {reading.words}"
        got = size if reading.size else f"{words}: it is {reading.words}"
        raise CheckFailed(group.what, got, reading.hint)
    expect(rough <= group.rough, group.what, words)


def _unit_vectors(group: Group, pairs: Iterable[tuple[Any, Truth]]) -> list[FloatArray]:
    """Return the vectors of all units of values, each given with the truth of its photo."""
    return [
        np.asarray(unit, np.float64)
        for value, truth in pairs
        for unit in group.vectors(value, truth)
    ]


def _differences(
    first_list: Sequence[FloatArray], second_list: Sequence[FloatArray]
) -> list[FloatArray]:
    return [first - second for first, second in zip(first_list, second_list, strict=True)]


def _is_constant(answered: Sequence[FloatArray], true: Sequence[FloatArray]) -> bool:
    """Return whether outputs hardly vary within a unit: they then look like a mean of anything."""
    finite = [unit for unit in zip(answered, true, strict=True) if np.isfinite(sum(unit)).any()]
    varies, spread = (sum(map(np.nanvar, side)) for side in zip(*finite, strict=True))
    return bool(varies < _CONSTANT * spread)


def _mistake_share_and_rest(
    group: Group, reading: KnownMistake, off: Sequence[FloatArray], mistakes: Sequence[FloatArray]
) -> tuple[float, float]:
    """Return the median share of a mistake, 0 unless most units show it, and the share of the
    squared error that is left if it is undone.
    """
    share = shares(off, mistakes, centred=group.centred)
    share = share[np.isfinite(share)]
    if len(share) < MIN_UNITS:
        return 0, 1
    middle = float(np.median(share))
    limit = reading.limit / (reading.size or 1)
    is_large = abs(middle) > limit and (reading.size > 0 or 0 < middle < MADE_ONCE)
    if not is_large or (share * np.sign(middle) > limit / 2).mean() < AGREE:
        return 0, 1
    rest = _differences(off, [middle * mistake for mistake in mistakes])
    left, whole = (sum(float(np.nansum(unit**2)) for unit in units) for units in (rest, off))
    return middle, 0 if group.centred else left / max(whole, 1e-30)


def shares(
    off: Sequence[FloatArray], mistakes: Sequence[FloatArray], *, centred: bool = False
) -> FloatArray:
    """Return the share (n,) of a mistake in what units are off by; NaN where it does not show."""
    if centred:
        off, mistakes = (
            [unit - np.nanmean(np.concatenate(units)) for unit in units]
            for units in (off, mistakes)
        )
    is_known = [np.isfinite(error + mistake) for error, mistake in zip(off, mistakes, strict=True)]
    sizes = np.array([(m[k] ** 2).sum() for m, k in zip(mistakes, is_known, strict=True)])
    products = [(e * m)[k].sum() for e, m, k in zip(off, mistakes, is_known, strict=True)]
    means = sizes / np.maximum([k.sum() for k in is_known], 1)
    shows = (sizes > 1e-18) & (means > _TELLING * means.max(initial=0))
    return np.where(shows, products / np.where(shows, sizes, 1), np.nan)


def expect_telling(probabilities: FloatArray, what: str) -> None:
    """Raise CheckFailed if all probabilities are the same, or have gone through a sigmoid twice."""
    finite = probabilities[np.isfinite(probabilities)]
    if finite.size and finite.any():
        got = f"{finite.min():.2f} to {finite.max():.2f} in all photos"
        expect(float(np.ptp(finite)) > _FLAT, what, got, "Is the network's answer used?")
        expect(not is_sigmoid_of_probability(finite), what, got, "Is a sigmoid applied twice?")


def check_stated_errors_hold(subject: BackendUnderTest) -> None:
    """Errors are plausible for the standard deviations that are stated of them."""
    apart = np.concatenate(
        [np.ravel(values.get("sigmas", np.nan)) for values, _ in values_of(subject)]
    )
    apart = apart[np.isfinite(apart)]
    if not apart.size:
        raise CheckSkipped("it states no error")
    expect(
        bool(np.median(apart) < MAX_SIGMAS),
        f"errors within {MAX_SIGMAS:g} stated sigmas",
        f"{np.median(apart):.3g} of them in the median",
        "Is sigma in the unit of its docstring? Is it a direction down, or with y up?",
    )


def search_order(
    names: Sequence[str], axis: int
) -> Callable[[str, Sequence[tuple[Values, Truth]]], list[KnownMistake]]:
    """Return the search for the order in which parts along an axis fit the truth best; without
    names, they are ``names`` of the truth.
    """

    def search(key: str, evidence: Sequence[tuple[Values, Truth]]) -> list[KnownMistake]:
        from scipy.optimize import linear_sum_assignment

        parts = names or evidence[0][1]["names"]
        answered, true = (
            np.concatenate([np.moveaxis(pair[side][key], axis, 1) for pair in evidence])
            for side in (0, 1)
        )
        answered, true = (side.reshape(len(side), len(parts), -1) for side in (answered, true))
        cost = np.linalg.norm(answered[:, :, None] - true[:, None], axis=3)
        counts = np.isfinite(cost).sum(axis=0)
        mean = np.nansum(cost, axis=0) / np.maximum(counts, 1)
        mean = np.where(counts < MIN_UNITS, 10 * np.max(mean, initial=1.0), mean)
        best = linear_sum_assignment(mean)[1]
        pairs = [f"{parts[j]} for {parts[k]}" for j, k in enumerate(best) if j != k]
        words = f"reordered: {', '.join(pairs[:4])}"
        hint = f"Is it the order of another data set? It is {', '.join(parts[:5])}, ..."
        return [KnownMistake(words, reordered(best, axis), hint)] if pairs else []

    return search
