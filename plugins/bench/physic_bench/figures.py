"""Figures of a benchmark with 95 % intervals, and paired differences between methods.

A column is a function of sums over records, so that a bootstrap draw is a weight for each group of
records: of films, moments or worlds, whose people are not independent.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_testing.metrics import (
    ContactCounts,
    ValueWithInterval,
    draw_counts,
    percentile_interval,
    precision_recall_f1,
)

if TYPE_CHECKING:
    from physic_core.types import Float64Array

    Record = Mapping[str, Any]


CONTACT_FIGURES = {
    "precision": ("contact precision", "mean precision of contact over people"),
    "recall": ("contact recall", "mean recall of contact over people"),
    "f1_of_means": (
        "contact F1",
        "harmonic mean of mean precision and mean recall, as the paper prints it",
    ),
    "f1_mean": ("contact F1, mean", "mean over people of their F1, as DECO prints it"),
    "f1_pooled": ("contact F1, pooled", "F1 of the vertices of all people"),
}


@dataclass(frozen=True)
class Column:
    """A figure of the tables.

    Attributes:
        key: unique.
        label: in the tables.
        definition: one sentence.
        sums: of one record, or None where the record has no value.
        value: of sums (..., k), an array (...).
        digits: printed.
        better: "low", "high" or "".
    """

    key: str
    label: str
    definition: str
    sums: Callable[[Record], Sequence[float] | None]
    value: Callable[[Float64Array], Float64Array]
    digits: int = 1
    better: str = "low"

    def text(self, figure: ValueWithInterval, *, signed: bool = False) -> str:
        """Return a figure as printed; "-" if it is unknown."""
        form = f"{'+' if signed else ''}.{self.digits}f"
        value, low, high = (
            f"{v:{form}}" if np.isfinite(v) else "-"
            for v in (figure.value, figure.low, figure.high)
        )
        return value if low == "-" else f"{value} [{low}, {high}]"


def mean_column(
    key: str, label: str, definition: str, digits: int = 1, better: str = "low"
) -> Column:
    """Return the mean of an entry over the records that have it."""
    return Column(
        key, label, definition, partial(_value_if_known, key=key), _mean_of_sums, digits, better
    )


def _value_if_known(record: Record, key: str) -> Sequence[float] | None:
    value = record.get(key)
    return (
        None
        if not isinstance(value, (int, float)) or not np.isfinite(value)
        else (float(value), 1.0)
    )


def _safe_ratio(top: Float64Array, bottom: Float64Array) -> Float64Array:
    """Return top / bottom; NaN where the bottom is 0."""
    return np.where(bottom > 0, top / np.where(bottom > 0, bottom, 1.0), np.nan)


def _mean_of_sums(sums: Float64Array) -> Float64Array:
    return _safe_ratio(sums[..., 0], sums[..., 1])


def contact_columns(
    counts: Callable[[Record], Mapping[str, int] | None], suffix: str = ""
) -> tuple[Column, ...]:
    """Return all averages of precision, recall and F1.

    Args:
        counts: of a record: its "hits", "false_alarms" and "misses", or None. Who is not "found"
            scores 0.
        suffix: of keys and labels, such as "@2 cm".
    """
    return tuple(
        Column(
            f"{key}{suffix}",
            f"{label} {suffix}".strip(),
            definition,
            partial(_contact_sums, counts=counts),
            partial(_contact_value, figure=key),
            3,
            "high",
        )
        for key, (label, definition) in CONTACT_FIGURES.items()
    )


def _contact_sums(
    record: Record, counts: Callable[[Record], Mapping[str, int] | None]
) -> Sequence[float] | None:
    totals = counts(record)
    if totals is None:
        return None
    counted = [np.asarray(totals[name], np.int64) for name in ("hits", "false_alarms", "misses")]
    scores = precision_recall_f1(ContactCounts(*counted)) if record["found"] else (0.0, 0.0, 0.0)
    return (*map(float, scores), *map(float, counted), 1.0)


def _contact_value(sums: Float64Array, figure: str) -> Float64Array:
    precision, recall, f1 = (_safe_ratio(sums[..., k], sums[..., 6]) for k in range(3))
    if figure == "f1_pooled":
        return _safe_ratio(2 * sums[..., 3], 2 * sums[..., 3] + sums[..., 4] + sums[..., 5])
    total = precision + recall
    harmonic = np.where(total > 0, _safe_ratio(2 * precision * recall, total), 0.0 * total)
    return {"precision": precision, "recall": recall, "f1_mean": f1, "f1_of_means": harmonic}[
        figure
    ]


def figure(records: Sequence[Record], column: Column) -> ValueWithInterval:
    """Return a column's figure over records of one method, each with its "group"."""
    sums, count, groups = _group_sums(records, column, _groups(records))
    if not count:
        return ValueWithInterval(np.nan)
    return _with_interval(
        sums.sum(0), column.value(draw_counts(len(sums)) @ sums), column.value, count, groups
    )


def difference(
    first: Sequence[Record], second: Sequence[Record], column: Column
) -> ValueWithInterval:
    """Return second minus first over the people, by "id", for whom both methods have a value, with
    the same draws.
    """
    ids = [{r["id"] for r in records if column.sums(r) is not None} for records in (first, second)]
    common = [[r for r in records if r["id"] in ids[0] & ids[1]] for records in (first, second)]
    if not common[0]:
        return ValueWithInterval(np.nan)
    groups = _groups([*first, *second])
    (first_sums, count, several), (second_sums, _, _) = (
        _group_sums(records, column, groups) for records in common
    )

    def difference_of_sums(sums: Float64Array) -> Float64Array:
        half = sums.shape[-1] // 2
        return column.value(sums[..., half:]) - column.value(sums[..., :half])

    both = np.concatenate([first_sums, second_sums], axis=1)
    return _with_interval(
        both.sum(0),
        difference_of_sums(draw_counts(len(both)) @ both),
        difference_of_sums,
        count,
        several,
    )


def _groups(records: Sequence[Record]) -> dict[str, int]:
    """Return the row of each group, in the order in which they occur."""
    return {
        name: row
        for row, name in enumerate(dict.fromkeys(str(record["group"]) for record in records))
    }


def _group_sums(
    records: Sequence[Record], column: Column, groups: Mapping[str, int]
) -> tuple[Float64Array, int, int]:
    """Return the sums (G, k) of the groups, the number of records with a value, and that of their
    groups.
    """
    rows = []
    values = []
    for record in records:
        sums = column.sums(record)
        if sums is not None:
            rows.append(groups[str(record["group"])])
            values.append(sums)
    total = np.zeros((len(groups), len(values[0]) if values else 1))
    np.add.at(total, rows, np.array(values, np.float64).reshape(-1, total.shape[1]))
    return total, len(values), len(set(rows))


def _with_interval(
    total: Float64Array,
    draws: Float64Array,
    value: Callable[[Float64Array], Float64Array],
    count: int,
    groups: int,
) -> ValueWithInterval:
    """Return a figure; one group has no interval."""
    low, high = percentile_interval(draws) if groups > 1 else (np.nan, np.nan)
    return ValueWithInterval(float(value(total)), low, high, count, groups)
