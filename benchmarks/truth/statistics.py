"""Figures with intervals, over records that share scenes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from physic_testing.metrics import ValueWithInterval, resampled_interval

Record = Mapping[str, Any]
Strata = Sequence[Sequence[Record]]
"""The records of each data set."""

_DRAWS = 1000


def figure(records: Sequence[Record], statistic: Callable[[Strata], float]) -> ValueWithInterval:
    """A statistic of the records by data set, and its interval by a bootstrap over the groups of
    each set.

    Groups are resampled, not people: those of one moment or film are alike. Photos are, where a set
    has one group alone. A set of one photo gives no interval, nor does a figure that it takes part
    in.
    """
    sets: dict[str, list[Record]] = {}
    for record in records:
        sets.setdefault(record["set"], []).append(record)
    strata = [
        max(
            _grouped(of_set, "group"), _grouped(of_set, "photo"), key=lambda groups: len(groups) > 1
        )
        for of_set in sets.values()
    ]

    def of_groups(drawn: Sequence[Sequence[Sequence[Record]]]) -> float:
        return statistic([[r for group in stratum for r in group] for stratum in drawn])

    value = of_groups(strata)
    return ValueWithInterval(value, *resampled_interval(strata, of_groups, _DRAWS), len(records))


def _grouped(records: Sequence[Record], key: str) -> list[list[Record]]:
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(record[key], []).append(record)
    return list(groups.values())


def mean_of(values: Sequence[float]) -> float:
    """Mean of the finite ones; NaN of none."""
    known = [float(v) for v in values if v is not None and math.isfinite(v)]
    return sum(known) / len(known) if known else math.nan


def rms_of(values: Sequence[float]) -> float:
    """Root mean square of the finite ones; NaN of none."""
    return math.sqrt(mean_of([v * v for v in values]))


def pooled(
    key: str, average: Callable[[Sequence[float]], float] = mean_of
) -> Callable[[Strata], float]:
    """Mean, or another average, over all records."""
    return lambda strata: average([r[key] for stratum in strata for r in stratum])


def of_sets(key: str) -> Callable[[Strata], float]:
    """Mean over the data sets of their means, so that a set of many photos does not drown the
    others.
    """
    return lambda strata: mean_of([mean_of([r[key] for r in stratum]) for stratum in strata])


def of_lists(key: str) -> Callable[[Strata], float]:
    """Mean over the numbers in a list of each record."""
    return lambda strata: mean_of([v for stratum in strata for r in stratum for v in r[key]])
