"""Figures, their intervals and paired differences, of records that are made by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physic_bench.figures import contact_columns, difference, figure, mean_column

pytestmark = pytest.mark.quick

ERROR = mean_column("error", "error", "")
CONTACT = {column.key: column for column in contact_columns(lambda record: record.get("contact"))}


def records(*groups, key="error"):
    """A record for each value of each group."""
    return [
        {"id": f"{g} {i}", "group": g, "found": True, key: value}
        for g, values in enumerate(groups)
        for i, value in enumerate(values)
    ]


def counts(hits, alarms, misses):
    return {"hits": hits, "false_alarms": alarms, "misses": misses}


def test_values_are_averaged_and_records_without_one_left_out():
    mean = figure(records([100.0, None], [200.0, 600.0], [np.nan]), ERROR)
    assert (mean.value, mean.count, mean.groups) == (300, 3, 2)
    assert figure(records([None]), ERROR).count == 0


def test_the_averages_of_contact_by_hand():
    people = records([counts(8, 2, 2), counts(1, 0, 9)], [counts(0, 5, 5)], key="contact")
    averages = {key: figure(people, column).value for key, column in CONTACT.items()}
    precision = (0.8 + 1 + 0) / 3
    recall = (0.8 + 0.1 + 0) / 3
    assert averages == pytest.approx(
        {
            "precision": precision,
            "recall": recall,
            "f1_of_means": 2 * precision * recall / (precision + recall),
            "f1_mean": (0.8 + 2 / 11 + 0) / 3,
            "f1_pooled": 2 * 9 / (2 * 9 + 7 + 16),
        }
    )


def test_a_person_without_a_body_scores_0():
    (missed,) = records([counts(0, 0, 9)], key="contact")
    missed["found"] = False
    assert {figure([missed], column).value for column in CONTACT.values()} == {0}


@given(st.lists(st.floats(1, 1000), min_size=2, max_size=12))
def test_the_interval_holds_the_mean_and_lies_within_the_values(values):
    mean = figure(records(*[[v] for v in values]), ERROR)
    ordered = np.array([min(values), mean.low, mean.value, mean.high, max(values)])
    assert (np.diff(ordered) >= -1e-9 * max(values)).all()


def test_methods_are_compared_on_the_same_people_and_draws():
    values = np.random.default_rng(0).uniform(50, 500, 30)
    first = records(*[[v] for v in values])
    second = records(*[[v - 5] for v in values[:20]])
    change = difference(first, second, ERROR)
    assert (change.value, change.low, change.high, change.count) == pytest.approx((-5, -5, -5, 20))
