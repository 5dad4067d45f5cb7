"""The fit of the probabilities that a person is right, on made-up verdicts."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.trust_on_photos import (
    TERMS,
    fitted,
    left_out_probabilities,
    probabilities,
    rightness,
)
from physic_core.judge.trust import ALL
from physic_core.types import MARKS

USUAL = {
    "contact_sure": 0.7,
    "detected": 0.7,
    "lean": 5.0,
    "body_in_mask": 0.97,
    "low_depth": 0.04,
    "support": 0.02,
    "scale_sigma": 0.1,
}


def person(number, lean, right):
    """A row of the table: who leans, and whether the reader finds the place right."""
    verdict = dict.fromkeys(MARKS, 1) | {"place": int(right)}
    return {
        "photo": f"repository{number}__photo",
        "verdicts": {"first": verdict},
        "checks": USUAL | {"lean": lean},
    }


@pytest.fixture
def people():
    """People who are right if they lean little, and half of those of unknown lean."""
    known = [person(n, lean, lean < 15) for n, lean in enumerate(np.linspace(0, 30, 40))]
    return known + [person(40 + n, None, n % 2 == 0) for n in range(10)]


def test_a_person_is_right_if_nothing_is_wrong(people):
    assert [rightness(people[0], ALL), rightness(people[39], ALL)] == [1, 0]
    assert [rightness(people[39], mark) for mark in MARKS] == [1, 0, 1, 1]
    second = people[39]["verdicts"]["first"]
    assert rightness({"verdicts": people[0]["verdicts"] | {"second": second}}, ALL) == 0.5


def test_only_what_tells_right_from_wrong_has_a_slope(people):
    models = fitted(people)
    assert set(models) == {*MARKS, ALL}
    for mark in ("place", ALL):
        assert set(models[mark]["terms"]) == {"lean"} <= set(TERMS)
        assert models[mark]["terms"]["lean"]["slope"] < -0.5
    assert models["size"]["terms"] == {}


def test_what_leads_to_right_people_never_lowers_the_probability():
    against = [person(n, lean, lean > 15) for n, lean in enumerate(np.linspace(0, 30, 40))]
    assert fitted(against)["place"]["terms"] == {}


def test_people_left_out_are_scored_by_the_others(people):
    likely = left_out_probabilities(people)["place"]
    assert likely[:15].min() > likely[25:40].max()
    assert np.abs(likely - probabilities(people, fitted(people))["place"]).max() < 0.25
