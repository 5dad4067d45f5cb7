"""Readings: what known mistakes make of the truth, and whether an output is one of them.

An output is compared as a vector for each unit, a person or a photo. A mistake puts it off by a
known vector. The share of that vector in what it is off by is 1 with the mistake and 0 without it.
A mistake counts if most units show it in the same direction.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from physic_testing.conformance.check import BLIND
from physic_testing.conformance.expect import CheckFailed, CheckSkipped

if TYPE_CHECKING:
    from physic_core.types import FloatArray
    from physic_testing.conformance.backend_under_test import BackendUnderTest
    from physic_testing.conformance.cases import Case

Values: TypeAlias = "dict[str, Any]"
"""An output in the form in which it is compared: names -> arrays."""

Make: TypeAlias = "Callable[[Values, Case], Values]"
"""Values of the truth, and the photo -> values with a mistake."""

MIN_UNITS = 3
"""Units without which nothing is known of a bias."""

MADE = 0.6
MADE_ONCE = 1.5
"""Shares between which a mistake is made; it is a half of an output that ignores the photo."""

AGREE = 0.8
"""Share of the units that must show a mistake in the same direction."""

EXPLAINS = 0.97
"""Largest share of the squared error that is left if a mistake is undone."""

_CONSTANT = 0.05  # share of the variance of the truth
_TELLING = 0.02  # share of the largest mistake from which on a unit shows it


@dataclass(frozen=True)
class Reading:
    """What a known mistake makes of the truth.

    Attributes:
        words: end of the sentence "the output is ...".
        make: values of the truth, and the photo -> values with the mistake.
        hint: likely cause.
        size: of a mistake that has any size, how large that of ``make`` is; 0 if it is made or not.
        unit: of the size.
        limit: largest size that is treated as zero, or the share from which on a mistake without a
            size is made.
        of_blind: whether an output that ignores the image can show it, too.
    """

    words: str
    make: Make
    hint: str = ""
    size: float = 0.0
    unit: str = ""
    limit: float = MADE
    of_blind: bool = False


@dataclass(frozen=True)
class Group:
    """What is compared by one check.

    Attributes:
        check: name of the check.
        what: what the contract requires.
        unit: of the errors.
        units: values, values of the truth, and the photo -> a vector for each unit, NaN where
            unknown.
        readings: other readings of the output.
        centred: only differences between the units count.
        rough: largest median error over the units.
        order: values -> rows (N, J, D) whose order is tested, and their names.
        after: names of further checks that come first.
    """

    check: str
    what: str
    unit: str
    units: Callable[[Values, Values, Case], Sequence[FloatArray]]
    readings: tuple[Reading, ...] = ()
    centred: bool = False
    rough: float = float("inf")
    order: tuple[str, Sequence[str], int] | None = None
    after: tuple[str, ...] = ()


@dataclass(frozen=True)
class Table:
    """How the outputs of an interface are compared.

    Attributes:
        parse: output, photo and values of the truth -> values of the output.
        truth: output and photo -> values of the truth.
        groups: what is compared.
        read: class that documents the output.
        after: names of checks that come first.
    """

    parse: Callable[[Any, Case, Values], Values]
    truth: Callable[[Any, Case], Values]
    groups: tuple[Group, ...]
    read: str
    after: tuple[str, ...] = ()


def values_of(subject: BackendUnderTest, table: Table) -> list[tuple[Case, Values, Values]]:
    """Return the photos of people with the values of output and truth."""
    if "values" not in subject.kept:
        found = []
        for case, answer in subject.evidence():
            truth = table.truth(answer, case)
            found.append((case, table.parse(answer, case, truth), truth))
        subject.kept["values"] = found
    kept: list[tuple[Case, Values, Values]] = subject.kept["values"]
    return kept


def shares(
    off: Sequence[FloatArray], mistakes: Sequence[FloatArray], *, centred: bool = False
) -> FloatArray:
    """Return the share (n,) of a mistake in what units are off by; NaN where it does not show."""
    if centred:
        off, mistakes = (_centred(vectors) for vectors in (off, mistakes))
    found = np.full(len(off), np.nan)
    sizes = np.zeros(len(off))
    for i, (error, mistake) in enumerate(zip(off, mistakes, strict=True)):
        known = np.isfinite(error) & np.isfinite(mistake)
        size = float(mistake[known] @ mistake[known])
        sizes[i] = size / max(known.sum(), 1)
        if size > 1e-18:
            found[i] = float(error[known] @ mistake[known]) / size
    return np.where(sizes > _TELLING * sizes.max(initial=0), found, np.nan)


def _centred(vectors: Sequence[FloatArray]) -> list[FloatArray]:
    means = [np.nanmean(vector) for vector in vectors if np.isfinite(vector).any()]
    return [vector - np.mean(means) for vector in vectors] if means else list(vectors)


def check_group(subject: BackendUnderTest, table: Table, group: Group) -> None:
    """Raise CheckFailed if outputs are one of the readings of a group.

    Raises:
        CheckSkipped: too few photos have a valid output.
    """
    evidence = values_of(subject, table)
    true = [group.units(truth, truth, case) for case, _, truth in evidence]
    off = _differences([group.units(values, truth, case) for case, values, truth in evidence], true)
    known = [unit for unit in off if np.isfinite(unit).any()]
    if len(known) < MIN_UNITS:
        raise CheckSkipped(f"{len(known)} people or photos to compare, {MIN_UNITS} are needed")
    rough = float(np.median([np.sqrt(np.nanmean(unit**2)) for unit in known]))
    made = []
    for reading in (*group.readings, *_order(group, evidence)):
        changed_units = [
            group.units(reading.make(truth, case), truth, case) for case, _, truth in evidence
        ]
        mistakes = _differences(changed_units, true)
        share = shares(off, mistakes, centred=group.centred)
        middle = _agreed(share, reading)
        left = _left(off, mistakes, middle)
        if middle and (group.centred or left < EXPLAINS):
            made.append((left, middle, reading))
    if _is_constant(off, true):
        made = []
    elif BLIND & subject.capabilities:
        made = [found for found in made if found[2].of_blind]
    if rough > group.rough or made:
        words = f"an error of {rough:.3g} {group.unit} in the median"
        if not made:
            raise CheckFailed(group.what, words)
        _, middle, reading = min(made, key=lambda item: item[0])
        if reading.size:
            words = f"{middle * reading.size:+.3g}{reading.unit} {reading.words}"
        else:
            words = f"{words}: it is {reading.words}"
        raise CheckFailed(group.what, words, reading.hint)


def _is_constant(off: Sequence[FloatArray], true: Sequence[Sequence[FloatArray]]) -> bool:
    """Return whether outputs hardly vary within a unit: they then look like a mean of anything."""
    truths = [vector for photo in true for vector in photo]
    pairs = [(o, t) for o, t in zip(off, truths, strict=True) if np.isfinite(o + t).any()]
    spread = sum(float(np.nanvar(t)) for _, t in pairs)
    return sum(float(np.nanvar(o + t)) for o, t in pairs) < _CONSTANT * spread


def _agreed(share: FloatArray, reading: Reading) -> float:
    """Return the median share of a mistake if it is made in most units; else 0."""
    share = share[np.isfinite(share)]
    if len(share) < MIN_UNITS:
        return 0.0
    middle = float(np.median(share))
    limit = reading.limit / reading.size if reading.size else reading.limit
    is_large = abs(middle) > limit and (reading.size > 0 or 0 < middle < MADE_ONCE)
    agrees = float((share * np.sign(middle) > limit / 2).mean()) >= AGREE
    return middle if is_large and agrees else 0.0


def _left(off: Sequence[FloatArray], mistakes: Sequence[FloatArray], share: float) -> float:
    """Return the share of the squared error that is left if a mistake is undone."""
    left = sum(float(np.nansum((o - share * m) ** 2)) for o, m in zip(off, mistakes, strict=True))
    return left / max(sum(float(np.nansum(o**2)) for o in off), 1e-30)


def _differences(
    own: Sequence[Sequence[FloatArray]], other: Sequence[Sequence[FloatArray]]
) -> list[FloatArray]:
    return [
        np.asarray(a, np.float64) - b
        for photo, second in zip(own, other, strict=True)
        for a, b in zip(photo, second, strict=True)
    ]


def _order(group: Group, evidence: Sequence[tuple[Case, Values, Values]]) -> list[Reading]:
    """Return as a reading the order in which rows fit the truth best; none if it is stated."""
    from scipy.optimize import linear_sum_assignment

    if group.order is None:
        return []
    key, names, axis = group.order
    names = names or evidence[0][2]["names"]
    apart = []
    for _, values, truth in evidence:
        own, true = (np.moveaxis(v[key], axis, 1) for v in (values, truth))
        if len(own):
            own, true = (side.reshape(len(own), len(names), -1) for side in (own, true))
            apart.append(np.linalg.norm(own[:, :, None] - true[:, None], axis=3))
    cost = np.concatenate(apart)
    known = np.isfinite(cost).sum(axis=0)
    mean = np.nansum(cost, axis=0) / np.maximum(known, 1)
    mean = np.where(known < MIN_UNITS, 10 * np.max(mean, initial=1.0), mean)
    best = linear_sum_assignment(mean)[1]
    moved = [j for j in range(len(best)) if best[j] != j]
    if not moved:
        return []
    pairs = ", ".join(f"{names[j]} for {names[best[j]]}" for j in moved[:4])
    hint = f"Is it the order of another data set? It is {', '.join(names[:5])}, ..."
    taken = changed(**{key: lambda rows: np.take(rows, best, axis)})
    return [Reading(f"reordered: {pairs}", taken, hint)]


def between(key: str, one: Make, other: Make) -> Make:
    """Return the ``make`` of a reading that is half of the way from a change to the opposite one.

    Outputs that show little of the photo have no share in it.
    """

    def make(values: Values, case: Case) -> Values:
        return values | {key: values[key] + (one(values, case)[key] - other(values, case)[key]) / 2}

    return make


def changed(**changes: Callable[[Any], Any]) -> Make:
    """Return the ``make`` of a reading that changes some values by functions of them."""
    return lambda values, _: (
        values | {name: change(values[name]) for name, change in changes.items()}
    )
