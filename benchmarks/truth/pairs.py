"""Figures of two builds on the same photos: paired differences, their intervals, and a verdict."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from physic_testing.metrics import markdown_table, resampled_interval

DRAWS = 1000
LIMIT = 0.05
"""A figure may be worse by this share of the other build's."""

LIMIT_OF_SHARES = 5.0
"""A share of cases may be larger by this many percent of all cases."""


class Verdict(StrEnum):
    """What the difference of a figure says."""

    BETTER = "better"
    KEPT = "kept"
    CANNOT_TELL = "cannot tell"
    WORSE = "WORSE"
    NOT_MEASURED = "not measured"


class Pair(NamedTuple):
    """An error of one case in both builds; smaller is better.

    Attributes:
        set: of photos, each of which is resampled for itself.
        unit: what is drawn in the resampling: a person, or a photo.
        name: for people.
        other: error in the other build.
        this: error in this one.
    """

    set: str
    unit: str
    name: str
    other: float
    this: float


def mean(values: Sequence[float]) -> float:
    """Return the mean."""
    return float(np.mean(values)) if len(values) else math.nan


def percentile(share: float) -> Callable[[Sequence[float]], float]:
    """Return the percentile of errors, as a statistic."""
    return lambda values: float(np.percentile(values, share)) if len(values) else math.nan


@dataclass(frozen=True)
class Figure:
    """A figure to compare.

    Attributes:
        name: with its unit.
        pairs: of all cases that both builds answer.
        statistic: of the errors of one build.
        is_share: whether the errors are 0 or 100 %, so that the limit is one of their difference.
        form: of its numbers.
    """

    name: str
    pairs: Sequence[Pair]
    statistic: Callable[[Sequence[float]], float] = mean
    is_share: bool = False
    form: str = ".1f"


@dataclass(frozen=True)
class Row:
    """A compared figure, in the figure's unit; the interval is that of ``this - other``."""

    figure: Figure
    other: float
    this: float
    low: float
    high: float
    limit: float

    @property
    def verdict(self) -> Verdict:
        """What the difference says; without an interval only equality does."""
        if not self.figure.pairs:
            return Verdict.NOT_MEASURED
        difference = self.this - self.other
        if all(pair.this == pair.other for pair in self.figure.pairs):
            return Verdict.KEPT
        if not (math.isfinite(self.low) and math.isfinite(self.high)):
            return Verdict.CANNOT_TELL
        if self.low > 0 and difference > self.limit:
            return Verdict.WORSE
        if self.high < 0:
            return Verdict.BETTER
        return Verdict.CANNOT_TELL if self.low <= 0 and self.high >= self.limit else Verdict.KEPT

    @property
    def count(self) -> int:
        """Number of cases."""
        return len(self.figure.pairs)

    @property
    def interval(self) -> str:
        """In words; "-" if there is none."""
        form = self.figure.form
        return f"{self.low:{form}} .. {self.high:{form}}" if math.isfinite(self.low) else "-"

    @property
    def largest_loss(self) -> Pair | None:
        """The case that lost most, if one lost."""
        lost = [pair for pair in self.figure.pairs if pair.this > pair.other]
        return max(lost, key=lambda pair: pair.this - pair.other, default=None)


def paired(
    key: str,
    other: Sequence[Mapping[str, Any]],
    this: Sequence[Mapping[str, Any]],
    unit: Sequence[str] = ("photo", "person"),
) -> list[Pair]:
    """Return the pairs of an error that records of both builds have; a list counts as its mean.

    Args:
        key: of the error.
        other: records with "set", "photo", and whatever ``unit`` names.
        this: the same of this build.
        unit: names of the case, the last of which may be missing.
    """

    def values(records: Sequence[Mapping[str, Any]]) -> dict[tuple[str, ...], float]:
        value_of = {}
        for record in records:
            value = record.get(key, math.nan)
            value = mean(value) if isinstance(value, list) else float(value)
            if math.isfinite(value):
                value_of[(record["set"], *(str(record[name]) for name in unit))] = value
        return value_of

    before, after = values(other), values(this)
    units = {
        (record["set"], *(str(record[name]) for name in unit)): record for record in (*other, *this)
    }
    pairs = []
    for case in before.keys() & after.keys():
        record = units[case]
        whom = (record.get("group", ""), record["person"]) if "person" in unit else case[1:2]
        pairs.append(
            Pair(case[0], " ".join(map(str, whom)), " ".join(case), before[case], after[case])
        )
    return sorted(pairs)


def compare(figure: Figure) -> Row:
    """Return a figure of both builds, and the interval of its difference by drawing units anew
    within each set. A set of one unit is drawn as it is.
    """
    before, after = ([getattr(p, name) for p in figure.pairs] for name in ("other", "this"))
    other, this = figure.statistic(before), figure.statistic(after)
    sets: dict[str, dict[str, list[Pair]]] = {}
    for pair in figure.pairs:
        sets.setdefault(pair.set, {}).setdefault(pair.unit, []).append(pair)
    strata = [list(units.values()) for units in sets.values()]
    fixed = [pair for units in strata if len(units) == 1 for pair in units[0]]

    def difference(drawn: Sequence[Sequence[Sequence[Pair]]]) -> float:
        pairs = [*fixed, *(pair for units in drawn for unit in units for pair in unit)]
        return figure.statistic([p.this for p in pairs]) - figure.statistic(
            [p.other for p in pairs]
        )

    several = [units for units in strata if len(units) > 1]
    low, high = resampled_interval(several, difference, DRAWS)
    limit = LIMIT_OF_SHARES if figure.is_share else LIMIT * abs(other)
    return Row(figure, other, this, low, high, limit)


def page(rows: Sequence[Row], title: str, words: Sequence[str] = ()) -> str:
    """Return the page of a comparison in Markdown: verdicts, the table, and the largest losses."""
    count = Counter(row.verdict for row in rows)
    summary = ", ".join(f"{verdict} {count[verdict]}" for verdict in Verdict)
    cells = [["figure", "other", "this", "difference", "95 % interval", "limit", "of", "verdict"]]
    for row in rows:
        if not row.count:
            cells.append([row.figure.name, "", "", "", "", "", "0", row.verdict])
            continue
        numbers = [row.other, row.this, row.this - row.other]
        form = row.figure.form
        shown = [f"{number:{form}}" for number in numbers]
        ends = row.interval, f"{row.limit:{form}}", str(row.count), row.verdict
        cells.append([row.figure.name, *shown, *ends])
    losses = [
        f"- {row.figure.name}: {loss.name}, {loss.other:{row.figure.form}} -> "
        f"{loss.this:{row.figure.form}}"
        for row in rows
        if row.verdict in (Verdict.WORSE, Verdict.CANNOT_TELL) and (loss := row.largest_loss)
    ]
    parts = [f"# {title}", *words, f"Figures: {summary}.", markdown_table(cells)]
    return "\n\n".join([*parts, *(["## Largest losses", "\n".join(losses)] if losses else [])])
