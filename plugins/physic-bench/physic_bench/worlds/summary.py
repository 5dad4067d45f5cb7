"""Means over people and worlds, with bootstrap confidence intervals.

The intervals are percentile bootstraps over worlds, because the people of one world share its scene and noise. All rows
use the same seeded draws, so that the difference of two rows has its own, narrower interval. Every statistic is a ratio
of sums over worlds, or a function of such ratios, so that a draw is a weight per world.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.worlds.contact_partners import BINS
from physic_bench.worlds.evaluation import PERSON_METRICS, WORLD_METRICS
from physic_core.metrics import ValueWithInterval, draw_counts, percentile_interval

if TYPE_CHECKING:
    from physic_core.types import FloatArray

_LEVEL = 95.0


@dataclass(frozen=True)
class RowStatistics:
    """Statistics of one table row.

    Attributes:
        figures: name -> statistic, for :data:`~physic_bench.worlds.evaluation.PERSON_METRICS` over people,
            :data:`~physic_bench.worlds.evaluation.WORLD_METRICS` over worlds, and ``f1_of_means``,
            ``precision_pooled``, ``recall_pooled``, ``f1_pooled``, ``f1_mean_image``, and
            :data:`~physic_bench.worlds.contact_partners.PARTNER_METRICS` and
            :data:`~physic_bench.worlds.support_scores.SUPPORT_METRICS`.
        people: number of true people.
        missed: number of people without a body; they count only in the contact means, with score 0.
        left_at_start: number of people with a body that the engine did not optimise.
        false_alarms: number of bodies without a true person.
        errors: number of worlds in which the row failed.
        draws: name -> (DRAWS,) values, for differences between rows.
        reliability: (BINS, 3) per bin of the contact probability: vertices, sum of their probabilities, and how many of
            them are in contact.
    """

    figures: Mapping[str, ValueWithInterval]
    people: int
    missed: int
    left_at_start: int
    false_alarms: int
    errors: int
    draws: Mapping[str, FloatArray]
    reliability: FloatArray


@dataclass(frozen=True)
class _Ratio:
    """Sum (W,) and count (W,) of one metric over the people of each world."""

    total: FloatArray
    count: FloatArray

    def value(self, weights: FloatArray) -> FloatArray:
        """Return means (B,) for world weights (B, W); NaN without data."""
        with np.errstate(invalid="ignore", divide="ignore"):
            answer: FloatArray = (weights @ self.total) / (weights @ self.count)
        return answer


def row_statistics(records: Sequence[Mapping[str, Any]], row: str) -> RowStatistics:
    """Average the metrics of one table row over all worlds."""
    rows = [record["rows"][row] for record in records]
    people = [[*r["people"]] for r in rows]
    ratios = {name: _ratio(people, name) for name in PERSON_METRICS}
    ratios |= {name: _ratio([[r["scene"]] for r in rows], name) for name in WORLD_METRICS if name != "seconds"}
    ratios["seconds"] = _ratio([[r] for r in rows], "seconds")
    ratios["f1_mean_image"] = _ratio([[{"f1": _image_f1(those)}] for those in people], "f1")
    ratios |= _partner_ratios(people)
    hits, alarms, misses = (_ratio(people, name).total for name in ("hits", "false_alarms", "misses"))
    ratios["precision_pooled"] = _Ratio(hits, hits + alarms)
    ratios["recall_pooled"] = _Ratio(hits, hits + misses)
    every = [person for those in people for person in those]
    answer, draws = _with_intervals(ratios)
    bins, unseen = _reliability(people, "reliability"), _reliability(people, "reliability_unseen")
    parts = {"ece": bins, "ece_likely": bins[:, 1:], "ece_seen": bins - unseen, "ece_unseen": unseen}
    for name, those in parts.items():
        answer[name], draws[name] = _calibration_error(those)
    return RowStatistics(
        figures=answer,
        people=len(every),
        missed=sum(not p["found"] for p in every),
        left_at_start=sum(bool(p["found"] and p["why"]) for p in every),
        false_alarms=sum(record["false_alarms"] for record in records),
        errors=sum(bool(r["error"]) for r in rows),
        draws=draws,
        reliability=bins.sum(axis=0),
    )


def truth_statistics(records: Sequence[Mapping[str, Any]]) -> Mapping[str, ValueWithInterval]:
    """Average the contact metrics of the ground truth itself, the lower bound for reconstructions."""
    people = [[person["measured"] for person in record["people"]] for record in records]
    names = [
        name
        for name in PERSON_METRICS
        if name.startswith(("penetration", "floating", "true_")) and "unscaled" not in name
    ]
    return _with_intervals({name: _ratio(people, name) for name in names})[0]


def row_difference(row: RowStatistics, base: RowStatistics, name: str) -> ValueWithInterval:
    """Return the mean difference of one metric between two rows, with its bootstrap interval."""
    spread = row.draws[name] - base.draws[name]
    low, high = percentile_interval(spread)
    return ValueWithInterval(
        row.figures[name].value - base.figures[name].value,
        low,
        high,
        min(row.figures[name].count, base.figures[name].count),
    )


def by_action(records: Sequence[Mapping[str, Any]], rows: Sequence[str]) -> dict[str, dict[str, dict[str, Any]]]:
    """Average the metrics by action and row: action -> row -> metric -> mean over the people of the action.

    "people", "missed" and "hidden_limbs_people" are counts. "hidden_limbs_change_mm" is the mean change of the
    hidden-limb error relative to the row "start" over the same people, and "hidden_limbs_change_half_mm" half of its
    95 % Student interval, NaN for a single person.
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
                **{name: float(ratio.value(once)[0]) for name, ratio in _partner_ratios([those]).items()},
            }
            if "start" in of_row:
                change, half = _paired_change(of_row["start"], those, "hidden_limbs_pa_mm")
                answer[action][row] |= {"hidden_limbs_change_mm": change, "hidden_limbs_change_half_mm": half}
    return answer


def _partner_ratios(people: Sequence[Sequence[Mapping[str, Any]]]) -> dict[str, _Ratio]:
    """Return the metrics of contact partners that are ratios of counts, over the people of each world."""

    def total(*names: str) -> FloatArray:
        counts: FloatArray = np.sum([_ratio(people, name).total for name in names], axis=0)
        return counts

    found = {
        "partner_accuracy": _Ratio(total("partner_right"), total("partner_found")),
        "item_recall": _Ratio(total("item_found"), total("item_found", "item_missed")),
        "brier": _Ratio(total("brier_sum"), total("brier_count")),
    }
    for kind in ("scene", "people", "self", "support", "reported_support"):
        name = f"{kind}_f1" if kind.endswith("support") else f"{kind}_contact_f1"
        hits, wrong = total(f"{kind}_hits"), total(f"{kind}_false_alarms", f"{kind}_misses")
        found[name] = _Ratio(2 * hits, 2 * hits + wrong)
    return found


def _reliability(people: Sequence[Sequence[Mapping[str, Any]]], name: str) -> FloatArray:
    """Return the counts (W, BINS, 3) of the reliability diagram of each world, recorded under a name."""
    empty = np.zeros((BINS, 3))
    return np.array([np.sum([person.get(name, empty) for person in those] or [empty], axis=0) for those in people])


def _calibration_error(bins: FloatArray) -> tuple[ValueWithInterval, FloatArray]:
    """Return the expected calibration error over some bins (W, b, 3) of each world, and its bootstrap draws."""
    off, count = bins[:, :, 1] - bins[:, :, 2], bins[:, :, 0].sum(axis=1)

    def error(weights: FloatArray) -> FloatArray:
        with np.errstate(invalid="ignore", divide="ignore"):
            value: FloatArray = np.abs(weights @ off).sum(axis=1) / (weights @ count)
        return value

    draws = error(draw_counts(len(bins)))
    value = float(error(np.ones((1, len(bins))))[0])
    return ValueWithInterval(value, *percentile_interval(draws), int(count.sum())), draws


def _paired_change(
    before: Sequence[Mapping[str, Any]], after: Sequence[Mapping[str, Any]], name: str
) -> tuple[float, float]:
    """Return the mean change of people with a value in both rows, and half of its 95 % Student interval."""
    from scipy.stats import t

    pairs = [(a.get(name), b.get(name)) for a, b in zip(before, after, strict=True)]
    moved = np.array([b - a for a, b in pairs if isinstance(a, (int, float)) and isinstance(b, (int, float))])
    if not len(moved):
        return float("nan"), float("nan")
    if len(moved) == 1:
        return float(moved[0]), float("nan")
    quantile = t.ppf((100 + _LEVEL) / 200, len(moved) - 1)
    return float(moved.mean()), float(quantile * moved.std(ddof=1) / np.sqrt(len(moved)))


def _with_intervals(ratios: Mapping[str, _Ratio]) -> tuple[dict[str, ValueWithInterval], dict[str, FloatArray]]:
    """Return the statistics and bootstrap draws of all metrics."""
    worlds = len(next(iter(ratios.values())).total)
    draws = {name: ratio.value(draw_counts(worlds)) for name, ratio in ratios.items()}
    values = {name: float(ratio.value(np.ones((1, worlds)))[0]) for name, ratio in ratios.items()}
    counts = {name: int(ratio.count.sum()) for name, ratio in ratios.items()}
    for made, parts in (("f1_of_means", ("precision", "recall")), ("f1_pooled", ("precision_pooled", "recall_pooled"))):
        if parts[0] in ratios:
            draws[made] = _harmonics(*(draws[part] for part in parts))
            values[made] = _harmonic(*(values[part] for part in parts))
            counts[made] = counts[parts[0]]
    answer = {
        name: ValueWithInterval(value, *percentile_interval(draws[name]), counts[name])
        for name, value in values.items()
    }
    return answer, draws


def _ratio(groups: Sequence[Sequence[Mapping[str, Any]]], name: str) -> _Ratio:
    """Return the sum and count of one metric in each group, ignoring people without it."""
    values = [[float(v) for m in members if isinstance(v := m.get(name), (int, float))] for members in groups]
    return _Ratio(np.array([sum(v) for v in values], np.float64), np.array([len(v) for v in values], np.float64))


def _image_f1(people: Sequence[Mapping[str, Any]]) -> float:
    """Return the F1 score over all people of an image."""
    hits, alarms, misses = (sum(p[name] for p in people) for name in ("hits", "false_alarms", "misses"))
    return 2 * hits / (2 * hits + alarms + misses) if hits else 0.0


def _harmonic(first: float, second: float) -> float:
    """Return the harmonic mean of two numbers."""
    return (
        2 * first * second / (first + second) if first + second > 0 else (0.0 if first == second == 0 else float("nan"))
    )


def _harmonics(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the harmonic mean of two arrays."""
    total = first + second
    answer: FloatArray = np.where(total > 0, 2 * first * second / np.where(total > 0, total, 1.0), 0.0 * total)
    return answer
