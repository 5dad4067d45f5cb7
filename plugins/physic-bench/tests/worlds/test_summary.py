"""Means and intervals of records that are made by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physic_bench.worlds.summary import by_action, row_difference, row_statistics


def person(hits=0, alarms=0, misses=0, **numbers):
    precision = hits / (hits + alarms) if hits + alarms else 1.0
    recall = hits / (hits + misses) if hits else 0.0
    counts = {"hits": hits, "false_alarms": alarms, "misses": misses, "precision": precision, "recall": recall}
    return {"found": True, "why": "", **counts, **numbers}


def record(*people, action="stand", scene=None, row="full", **others):
    true = [{"action": action, "measured": {"floating_mm": 11.0, "penetration_mm": 0.0}} for _ in people]
    rows = {
        key: {"people": list(those), "scene": scene or {}, "seconds": 1.0, "error": ""} for key, those in others.items()
    }
    rows[row] = {"people": list(people), "scene": scene or {}, "seconds": 2.0, "error": ""}
    return {"name": "stand", "seed": 0, "people": true, "false_alarms": 0, "error": "", "rows": rows}


def test_the_three_ways_to_average_contact_by_hand():
    records = [record(person(8, 2, 2), person(1, 0, 9)), record(person(0, 5, 5))]
    found = row_statistics(records, "full").figures
    assert found["precision"].value == pytest.approx((0.8 + 1 + 0) / 3)
    assert found["recall"].value == pytest.approx((0.8 + 0.1 + 0) / 3)
    p, r = found["precision"].value, found["recall"].value
    assert found["f1_of_means"].value == pytest.approx(2 * p * r / (p + r))
    assert found["precision_pooled"].value == pytest.approx(9 / 16)
    assert found["recall_pooled"].value == pytest.approx(9 / 25)
    assert found["f1_pooled"].value == pytest.approx(2 * 9 / (2 * 9 + 7 + 16))
    # The first image has both people's vertices together.
    assert found["f1_mean_image"].value == pytest.approx((2 * 9 / (2 * 9 + 2 + 11) + 0) / 2)
    assert (found["precision"].count, found["f1_of_means"].count, found["f1_mean_image"].count) == (3, 3, 2)


def test_people_are_averaged_and_those_without_a_number_left_out():
    records = [
        record(person(mpjpe_mm=100.0, hidden_limbs_pa_mm=None), person(mpjpe_mm=200.0, hidden_limbs_pa_mm=50.0)),
        record(person(mpjpe_mm=600.0, hidden_limbs_pa_mm=None), scene={"scene_point_mm": 40.0}),
    ]
    found = row_statistics(records, "full").figures
    assert (found["mpjpe_mm"].value, found["mpjpe_mm"].count) == (300, 3)
    assert (found["hidden_limbs_pa_mm"].value, found["hidden_limbs_pa_mm"].count) == (50, 1)
    assert (found["scene_point_mm"].value, found["scene_point_mm"].count) == (40, 1)
    assert (found["seconds"].value, found["seconds"].count) == (2, 2)
    assert found["pa_mpjpe_mm"].count == 0
    assert np.isnan(found["pa_mpjpe_mm"].value)


def test_missed_and_unmatched_people_are_counted():
    missed = {"found": False, "why": "no person was found there", "hits": 0, "false_alarms": 0, "misses": 7}
    missed |= {"precision": 0.0, "recall": 0.0, "f1": 0.0}
    records = [record(person(5, 0, 0, mpjpe_mm=10.0), missed), record({**person(5, 0, 0), "why": "the steps diverged"})]
    records[1]["false_alarms"] = 2
    row = row_statistics(records, "full")
    assert (row.people, row.missed, row.left_at_start, row.false_alarms, row.errors) == (3, 1, 1, 2, 0)
    assert row.figures["mpjpe_mm"].value == 10
    assert row.figures["recall"].value == pytest.approx(2 / 3)
    assert row.figures["recall_pooled"].value == pytest.approx(10 / 17)


@given(st.lists(st.floats(1, 1000), min_size=1, max_size=12))
def test_the_interval_holds_the_mean_and_lies_within_the_values(values):
    found = row_statistics([record(person(mpjpe_mm=v)) for v in values], "full").figures["mpjpe_mm"]
    assert found.value == pytest.approx(np.mean(values))
    slack = 1e-9 * max(values)
    assert min(values) - slack <= found.low <= found.high <= max(values) + slack


def test_people_of_one_world_are_drawn_together():
    values = np.random.default_rng(0).normal(100, 20, 50)
    alone = row_statistics([record(person(mpjpe_mm=v)) for v in values], "full").figures["mpjpe_mm"]
    thrice = row_statistics([record(*[person(mpjpe_mm=v)] * 3) for v in values], "full").figures["mpjpe_mm"]
    assert thrice.high - thrice.low == pytest.approx(alone.high - alone.low)


def test_rows_are_compared_on_the_same_draws():
    values = np.random.default_rng(0).uniform(50, 500, 30)
    records = [record(person(mpjpe_mm=v - 5), start=[person(mpjpe_mm=v)]) for v in values]
    change = row_difference(row_statistics(records, "full"), row_statistics(records, "start"), "mpjpe_mm")
    assert change.value == pytest.approx(-5)
    assert (change.low, change.high) == (pytest.approx(-5), pytest.approx(-5))


def test_hidden_limbs_are_compared_person_by_person():
    """Changes of -10 and -4 mm: their mean's standard error is 3 mm, and Student's factor for two people 12.706."""
    records = [
        record(person(hidden_limbs_pa_mm=end), action=action, start=[person(hidden_limbs_pa_mm=begin)])
        for action, begin, end in (
            ("lie", 50.0, 40.0),
            ("lie", 70.0, 66.0),
            ("lie", None, None),
            ("walk", 14.0, 38.0),
            ("stand", None, None),
        )
    ]
    found = {action: rows["full"] for action, rows in by_action(records, ["start", "full"]).items()}
    change = {a: (r["hidden_limbs_change_mm"], r["hidden_limbs_change_half_mm"]) for a, r in found.items()}
    assert change["lie"] == pytest.approx((-7.0, 3 * 12.7062), abs=1e-3)
    assert change["walk"] == pytest.approx((24.0, np.nan), nan_ok=True)
    assert np.isnan(change["stand"]).all()
    alone = by_action(records, ["full"])
    assert "hidden_limbs_change_mm" not in alone["lie"]["full"]
