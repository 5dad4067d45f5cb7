"""Means over people and worlds, each with a confidence interval.

The intervals are percentile bootstraps over worlds, since the people of one world share its scene and its noise: worlds
are drawn with replacement, seeded, the same draws for every row, so that the difference of two rows has its own and
narrower interval. Every figure is a ratio of sums over worlds, or made of such ratios, so that a draw is a weight per
world.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_testing.bench.judge import PERSON_METRICS, WORLD_METRICS

if TYPE_CHECKING:
    from physic_core.types import FloatArray

__all__ = ["DRAWS", "Figure", "Figures", "by_action", "difference", "figures", "truth_figures"]

DRAWS = 2000
"""Bootstrap draws."""

_LEVEL = 95.0
_SEED = 20_260_101


@dataclass(frozen=True)
class Figure:
    """A mean and its interval.

    Attributes:
        value: NaN where nothing was measured.
        low: 2.5th percentile of the draws.
        high: 97.5th.
        count: people, or worlds, that it is the mean of.
    """

    value: float
    low: float
    high: float
    count: int


@dataclass(frozen=True)
class Figures:
    """One row.

    Attributes:
        figures: by name: :data:`~physic_testing.bench.judge.PERSON_METRICS` over people,
            :data:`~physic_testing.bench.judge.WORLD_METRICS` over worlds, and ``f1_of_means``, ``precision_pooled``,
            ``recall_pooled``, ``f1_pooled``, ``f1_mean_image``.
        people: true people in the worlds.
        missed: of these, how many have no body, and count in no mean but those of contact, where they score 0.
        left_at_start: people with a body whom the engine did not optimise.
        false_alarms: bodies that are nobody.
        errors: worlds in which the row ended with an error.
        draws: name -> (DRAWS,) values, for differences of rows.
    """

    figures: Mapping[str, Figure]
    people: int
    missed: int
    left_at_start: int
    false_alarms: int
    errors: int
    draws: Mapping[str, FloatArray]


@dataclass(frozen=True)
class _Ratio:
    """Sums (W,) of one figure over the people of each world, and how many they are of."""

    total: FloatArray
    count: FloatArray

    def value(self, weights: FloatArray) -> FloatArray:
        """(B,) for weights (B, W); NaN where nothing is counted."""
        with np.errstate(invalid="ignore", divide="ignore"):
            answer: FloatArray = (weights @ self.total) / (weights @ self.count)
        return answer


def figures(records: Sequence[Mapping[str, Any]], row: str) -> Figures:
    """One row's means over the worlds' records."""
    rows = [record["rows"][row] for record in records]
    people = [[*r["people"]] for r in rows]
    ratios = {name: _ratio(people, name) for name in PERSON_METRICS}
    ratios |= {name: _ratio([[r["scene"]] for r in rows], name) for name in WORLD_METRICS if name != "seconds"}
    ratios["seconds"] = _ratio([[r] for r in rows], "seconds")
    ratios["f1_mean_image"] = _ratio([[{"f1": _image_f1(those)}] for those in people], "f1")
    hits, alarms, misses = (_ratio(people, name).total for name in ("hits", "false_alarms", "misses"))
    ratios["precision_pooled"] = _Ratio(hits, hits + alarms)
    ratios["recall_pooled"] = _Ratio(hits, hits + misses)
    every = [person for those in people for person in those]
    answer, draws = _with_intervals(ratios)
    return Figures(
        figures=answer,
        people=len(every),
        missed=sum(not p["found"] for p in every),
        left_at_start=sum(bool(p["found"] and p["why"]) for p in every),
        false_alarms=sum(record["false_alarms"] for record in records),
        errors=sum(bool(r["error"]) for r in rows),
        draws=draws,
    )


def truth_figures(records: Sequence[Mapping[str, Any]]) -> Mapping[str, Figure]:
    """What the measures of touch say of the truth itself: what no reconstruction need beat."""
    people = [[person["measured"] for person in record["people"]] for record in records]
    names = [name for name in PERSON_METRICS if name.startswith(("penetration", "floating"))]
    return _with_intervals({name: _ratio(people, name) for name in names})[0]


def difference(row: Figures, base: Figures, name: str) -> Figure:
    """Mean difference of one metric between two rows of the table, with an interval from resampled worlds."""
    spread = row.draws[name] - base.draws[name]
    low, high = _interval(spread)
    return Figure(
        row.figures[name].value - base.figures[name].value,
        low,
        high,
        min(row.figures[name].count, base.figures[name].count),
    )


def by_action(records: Sequence[Mapping[str, Any]], rows: Sequence[str]) -> dict[str, dict[str, dict[str, Any]]]:
    """Action -> row -> means over the people who do it; no intervals, for they are few, but of one figure.

    "people", "missed" and "hidden_limbs_people" are counts. Two rows are comparable where they miss nobody.
    "hidden_limbs_change_mm" is how much farther off hidden limbs are than in the row "start", the same people taken
    together, and "hidden_limbs_change_half_mm" half its 95 % interval after Student, NaN for a single person.
    """
    answer: dict[str, dict[str, dict[str, Any]]] = {}
    for action in dict.fromkeys(person["action"] for record in records for person in record["people"]):
        answer[action] = {}
        of_row = {
            row: [
                found
                for record in records
                for true, found in zip(record["people"], record["rows"][row]["people"], strict=True)
                if true["action"] == action
            ]
            for row in rows
        }
        for row, those in of_row.items():
            ratios = {name: _ratio([those], name) for name in PERSON_METRICS}
            once = np.ones((1, 1))
            answer[action][row] = {
                "people": len(those),
                "missed": sum(not person["found"] for person in those),
                "hidden_limbs_people": int(ratios["hidden_limbs_pa_mm"].count.sum()),
                **{name: float(ratio.value(once)[0]) for name, ratio in ratios.items()},
                "f1_of_means": _harmonic(*(float(ratios[n].value(once)[0]) for n in ("precision", "recall"))),
            }
            if "start" in of_row:
                change, half = _change(of_row["start"], those, "hidden_limbs_pa_mm")
                answer[action][row] |= {"hidden_limbs_change_mm": change, "hidden_limbs_change_half_mm": half}
    return answer


def _change(before: Sequence[Mapping[str, Any]], after: Sequence[Mapping[str, Any]], name: str) -> tuple[float, float]:
    """Mean change of those who have a number in both, and half its 95 % interval after Student."""
    from scipy.stats import t

    pairs = [(a.get(name), b.get(name)) for a, b in zip(before, after, strict=True)]
    moved = np.array([b - a for a, b in pairs if isinstance(a, (int, float)) and isinstance(b, (int, float))])
    if not len(moved):
        return float("nan"), float("nan")
    if len(moved) == 1:
        return float(moved[0]), float("nan")
    quantile = t.ppf((100 + _LEVEL) / 200, len(moved) - 1)
    return float(moved.mean()), float(quantile * moved.std(ddof=1) / np.sqrt(len(moved)))


def _with_intervals(ratios: Mapping[str, _Ratio]) -> tuple[dict[str, Figure], dict[str, FloatArray]]:
    worlds = len(next(iter(ratios.values())).total)
    draws = {name: ratio.value(_weights(worlds)) for name, ratio in ratios.items()}
    values = {name: float(ratio.value(np.ones((1, worlds)))[0]) for name, ratio in ratios.items()}
    counts = {name: int(ratio.count.sum()) for name, ratio in ratios.items()}
    for made, parts in (("f1_of_means", ("precision", "recall")), ("f1_pooled", ("precision_pooled", "recall_pooled"))):
        if parts[0] in ratios:
            draws[made] = _harmonics(*(draws[part] for part in parts))
            values[made] = _harmonic(*(values[part] for part in parts))
            counts[made] = counts[parts[0]]
    answer = {name: Figure(value, *_interval(draws[name]), counts[name]) for name, value in values.items()}
    return answer, draws


def _weights(worlds: int) -> FloatArray:
    rng = np.random.default_rng(_SEED)
    return rng.multinomial(worlds, np.full(worlds, 1 / max(worlds, 1)), DRAWS).astype(np.float64)


def _interval(draws: FloatArray) -> tuple[float, float]:
    known = draws[np.isfinite(draws)]
    if not len(known):
        return float("nan"), float("nan")
    low, high = np.percentile(known, [(100 - _LEVEL) / 2, (100 + _LEVEL) / 2])
    return float(low), float(high)


def _ratio(groups: Sequence[Sequence[Mapping[str, Any]]], name: str) -> _Ratio:
    """Sums of one number over the members of each world; those who do not have it are not counted."""
    values = [[float(v) for m in members if isinstance(v := m.get(name), (int, float))] for members in groups]
    return _Ratio(np.array([sum(v) for v in values], np.float64), np.array([len(v) for v in values], np.float64))


def _image_f1(people: Sequence[Mapping[str, Any]]) -> float:
    hits, alarms, misses = (sum(p[name] for p in people) for name in ("hits", "false_alarms", "misses"))
    return 2 * hits / (2 * hits + alarms + misses) if hits else 0.0


def _harmonic(first: float, second: float) -> float:
    return (
        2 * first * second / (first + second) if first + second > 0 else (0.0 if first == second == 0 else float("nan"))
    )


def _harmonics(first: FloatArray, second: FloatArray) -> FloatArray:
    total = first + second
    answer: FloatArray = np.where(total > 0, 2 * first * second / np.where(total > 0, total, 1.0), 0.0 * total)
    return answer
