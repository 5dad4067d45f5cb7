"""Trust: a probability of each mark of a person and of all, which no worse value of a check raises;
its reasons.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_core.judge import CHECKS, person_trust, photo_trust
from physic_core.judge.trust import ALL, CAP, load_of, probabilities_of, trust_models
from physic_core.pipeline.reconstruction import judge
from physic_core.types import MARKS, Grade, grade_text

MODELS = trust_models()
MODEL = MODELS[ALL]
TERMS = sorted(MODEL["terms"])


def value_at(name, load):
    """The value of a check at a load."""
    spec = CHECKS[name]
    if spec.direction == "at most":
        return load * spec.threshold
    return 1 - load * (1 - spec.threshold) if spec.unit == "share" else 1 + spec.threshold - load


def best():
    """The best values of all checks of the model."""
    return {name: value_at(name, 0.0) for name in MODEL["terms"]}


def results(**values):
    """Checks of the photo and of person 0, the best ones unless other values are given."""
    given = best() | values
    return tuple(
        CHECKS[name].compare(value, None if CHECKS[name].of == "photo" else 0)
        for name, value in given.items()
    )


@pytest.mark.parametrize("name", TERMS)
def test_a_worse_value_never_raises_the_probability(name):
    found = [
        probabilities_of(best() | {name: value_at(name, load)}, MODELS)
        for load in (0.0, 0.4, 0.8, 1.0, 1.5, 3.0, 9.0)
    ]
    for mark in (*MARKS, ALL):
        likely = [one[mark] for one in found]
        assert likely == sorted(likely, reverse=True)
        assert likely[-1] == likely[-2]


@pytest.mark.parametrize("name", TERMS)
def test_what_was_not_measured_costs_nothing(name):
    for mark in MARKS:
        usual = value_at(name, MODELS[mark]["terms"].get(name, {"usual": 0.0})["usual"])
        measured = probabilities_of(best() | {name: usual}, MODELS)
        assert probabilities_of(best() | {name: None}, MODELS)[mark] == pytest.approx(
            measured[mark]
        )


def test_all_are_at_most_as_probable_as_each_mark_and_fall_from_good_to_bad():
    for load in (0.0, 0.5, 1.0, 3.0):
        found = probabilities_of({name: value_at(name, load) for name in TERMS}, MODELS)
        assert found[ALL] <= min(found[mark] for mark in MARKS)
    assert found[ALL] < 0.1
    assert min(probabilities_of(best(), MODELS).values()) >= 0.8


@pytest.mark.parametrize(
    ("value", "name", "load"),
    [
        (None, "lean", None),
        (7.5, "lean", 0.5),
        (90.0, "lean", 3.0),
        (0.85, "body_in_mask", 1.0),
        (1.0, "body_in_mask", 0.0),
        (1.0, "placed", 1.0),
        (0.0, "placed", 2.0),
        (1.0, "heads", 1.0),
    ],
)
def test_a_load_is_one_at_the_limit(value, name, load):
    spec = CHECKS[name]
    assert load_of(value, spec.threshold, spec.direction, spec.unit) == pytest.approx(load)


@pytest.mark.parametrize("name", [name for name, spec in CHECKS.items() if spec.contradicts])
def test_a_contradiction_caps_the_probability_and_is_named_first(name):
    wrong = CHECKS[name].compare(value_at(name, 1.5) if name != "heads" else 2.0, 0)
    assert wrong.failed
    others = [one for one in results() if one.name != name]
    trust = person_trust([*others, wrong], 0)
    assert trust.probability <= CAP
    assert {mark for mark in MARKS if trust.marks[mark] <= CAP} == set(CHECKS[name].contradicts)
    assert trust.why.startswith(wrong.title)


def test_two_contradictions_make_a_person_bad():
    trust = person_trust(results(limb_keypoints=0.2, support=0.5), 0)
    assert Grade.of(trust.probability) is Grade.BAD


def test_the_two_checks_that_lower_the_probability_most_are_named():
    assert ";" not in person_trust(results(), 0).why
    lowest = sorted(MODEL["terms"], key=lambda name: MODEL["terms"][name]["slope"])
    worst = [name for name in lowest if not CHECKS[name].contradicts][:3]
    checks = results(**{name: value_at(name, 3.0) for name in worst})
    why = person_trust(checks, 0).why
    named = [one.title for one in checks if one.title in why]
    assert len(named) == 2
    assert all(CHECKS[one.name].advice[1:] in why for one in checks if one.title in named)


@pytest.mark.parametrize(("load", "limit"), [(1.0, "below 0.30"), (0.3, "below 0.80")])
def test_who_is_not_good_without_a_failed_check_is_told_the_next_limit(load, limit):
    checks = results(**{name: value_at(name, load) for name in TERMS})
    assert not any(check.failed for check in checks)
    of_photo = CHECKS["unposed_people"].compare(1.0)
    trust = person_trust(checks, 0)
    assert person_trust([*checks, of_photo], 0) == trust
    assert Grade.of(trust.probability) is not Grade.GOOD
    assert "failed" in trust.why
    assert limit in trust.why


def test_checks_of_other_people_do_not_count():
    own = results()
    other = [replace(one, person=1) for one in results(lean=80.0) if one.person == 0]
    assert person_trust([*own, *other], 0) == person_trust(own, 0)
    assert person_trust([*own, *other], 1).probability < person_trust(own, 0).probability


def test_a_person_half_as_large_does_not_decide_about_the_photo(reconstruction):
    main = replace(reconstruction.people[0], box=np.array([10.0, 0.0, 30.0, 100.0]), stature=1.7)
    small = replace(main, box=np.array([50.0, 0.0, 70.0, 49.0]), stature=None)  # without a body
    found = judge(replace(reconstruction, people=(main, small)), ())
    assert found.trust == found.people[0].trust > found.people[1].trust == 0


def test_a_photo_is_as_good_as_its_worst_main_person():
    assert photo_trust(results(), [0.9, 0.4]) == 0.4
    assert photo_trust(results(), []) is None
    failed = CHECKS["scale_sigma"].compare(0.4)
    assert photo_trust([*results(), failed], [0.9]) == CAP
    assert photo_trust([*results(), failed, CHECKS["unposed_people"].compare(1.0)], [0.9]) == CAP


@pytest.mark.parametrize(
    ("trust", "grade", "text"),
    [
        (0.91, Grade.GOOD, "good, 0.91"),
        (0.796, Grade.DOUBTFUL, "doubtful, 0.79"),
        (0.3, Grade.DOUBTFUL, "doubtful, 0.30"),
        (0.29709, Grade.BAD, "bad, 0.29"),
        (None, Grade.DOUBTFUL, "doubtful"),
    ],
)
def test_a_grade_is_a_range_of_the_probability(trust, grade, text):
    assert Grade.of(trust) is grade
    assert grade_text(grade, trust) == text


def test_marks_of_another_grade_are_said_beside_it():
    marks = {"pose": 0.6, "place": 0.95, "contact": 0.9, "size": 0.9}
    assert grade_text(Grade.DOUBTFUL, 0.55, marks) == (
        "doubtful, 0.55; place, contact and size good"
    )
    assert grade_text(Grade.GOOD, 0.9, dict.fromkeys(MARKS, 0.9)) == "good, 0.90"
    assert grade_text(Grade.BAD, 0.1, {**marks, "size": None, "pose": 0.2}) == (
        "bad, 0.10; place and contact good"
    )


def test_a_person_whom_no_check_lowers_is_told_where_to_look():
    usual = {name: value_at(name, term["usual"]) for name, term in MODEL["terms"].items()}
    trust = person_trust(results(**usual), 0)
    assert Grade.of(trust.probability) is not Grade.GOOD
    assert not any(
        CHECKS[name].compare(usual[name], 0).title in trust.why for name in MODEL["terms"]
    )
    assert "compare" in trust.why.lower()
