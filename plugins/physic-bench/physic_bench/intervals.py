"""Figures with bootstrap intervals over sequences, and paired differences between methods.

People of one sequence are not independent, so that sequences are drawn. Where there is one sequence alone, moments are
drawn: all views of a moment, or a frame.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.metrics import ValueWithInterval, draw_counts, percentile_interval

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_bench.metrics import Column

    Array = NDArray[np.float64]
    Record = Mapping[str, Any]


def figure(records: Sequence[Record], column: Column) -> ValueWithInterval:
    """Return a column's figure over the records of one method."""
    sums, count = _group_sums(records, column, _group_key(records))
    if not len(sums):
        return ValueWithInterval(np.nan)
    draws = column.value(draw_counts(len(sums)) @ sums)
    return _figure(float(column.value(sums.sum(0))), draws, count, len(sums))


def difference(first: Sequence[Record], second: Sequence[Record], column: Column) -> ValueWithInterval:
    """Return second minus first over the people for whom both methods have a value; both get the same draws."""
    known = [{(r["frame"], r["person"]) for r in records if column.sums(r) is not None} for records in (first, second)]
    both = known[0] & known[1]
    kept = [
        sorted((r for r in records if (r["frame"], r["person"]) in both), key=lambda r: (r["frame"], r["person"]))
        for records in (first, second)
    ]
    if not both:
        return ValueWithInterval(np.nan)
    key = _group_key(kept[0])
    (one, count), (two, _) = (_group_sums(records, column, key) for records in kept)
    weights = draw_counts(len(one))
    value = float(column.value(two.sum(0)) - column.value(one.sum(0)))
    return _figure(value, column.value(weights @ two) - column.value(weights @ one), count, len(one))


def _group_key(records: Sequence[Record]) -> Callable[[Record], str]:
    """Return the function that names the independent group of a record."""
    if len({r["sequence"] for r in records}) > 1:
        return lambda record: str(record["sequence"])
    return lambda record: str(record.get("group") or record["frame"])


def _group_sums(records: Sequence[Record], column: Column, key: Callable[[Record], str]) -> tuple[Array, int]:
    """Return the sums (G, k) of the groups in the order of their names, and the number of records with a value."""
    groups: dict[str, Array] = {}
    count = 0
    for record in records:
        sums = column.sums(record)
        if sums is not None:
            count += 1
            name = key(record)
            groups[name] = groups.get(name, 0.0) + np.array(sums)
    return np.array([groups[name] for name in sorted(groups)]), count


def _figure(value: float, draws: Array, count: int, groups: int) -> ValueWithInterval:
    """Return a figure; one group has no interval."""
    low, high = percentile_interval(draws) if groups > 1 else (np.nan, np.nan)
    return ValueWithInterval(value, low, high, count, groups)
