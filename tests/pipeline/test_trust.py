"""Trust: a probability of each mark of a person and of all, which no worse value of a check raises;
its reasons.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from physic_core.judge import CHECKS, person_trust
from physic_core.judge.trust import ALL, CAP, probabilities_of, trust_models
from physic_core.types import MARKS, is_usable

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


@pytest.mark.parametrize("name", [name for name, spec in CHECKS.items() if spec.contradicts])
def test_a_contradiction_caps_the_probability_and_is_named_first(name):
    wrong = CHECKS[name].compare(value_at(name, 1.5) if name != "heads" else 2.0, 0)
    assert wrong.failed
    others = [one for one in results() if one.name != name]
    trust = person_trust([*others, wrong], 0)
    assert trust.probability <= CAP
    assert {mark for mark in MARKS if trust.marks[mark] <= CAP} == set(CHECKS[name].contradicts)
    assert trust.why.startswith(wrong.title)


def test_every_failed_check_is_named_and_the_two_worst_with_what_to_do():
    lowest = sorted(MODEL["terms"], key=lambda name: MODEL["terms"][name]["slope"])
    worst = [
        name for name in lowest if CHECKS[name].of == "person" and not CHECKS[name].contradicts
    ][:3]
    checks = results(**{name: value_at(name, 3.0) for name in worst})
    why = person_trust(checks, 0).why
    assert all(CHECKS[name].label in why for name in worst)
    assert sum(CHECKS[name].advice[1:] in why for name in worst if CHECKS[name].advice) <= 2


def test_a_surface_that_the_depth_lacks_lowers_contact_alone():
    without, with_surface = (
        probabilities_of(best() | {"unknown_contacts": count}, MODELS) for count in (2.0, 0.0)
    )
    lower = {mark for mark in MARKS if without[mark] < with_surface[mark]}
    assert lower == {"contact"}


def test_who_is_doubtful_without_a_failed_check_is_told_in_what():
    checks = results(**{name: value_at(name, 0.9) for name in TERMS})
    assert not any(check.failed for check in checks if check.person == 0)
    trust = person_trust(checks, 0)
    assert person_trust([*checks, CHECKS["unposed_people"].compare(1.0)], 0) == trust
    doubtful = [mark for mark in MARKS if not is_usable(trust.marks[mark])]
    assert doubtful
    assert all(mark in trust.why for mark in doubtful)


def test_checks_of_other_people_do_not_count():
    own = results()
    other = [replace(one, person=1) for one in results(lean=80.0) if one.person == 0]
    assert person_trust([*own, *other], 0) == person_trust(own, 0)
    assert person_trust([*own, *other], 1).probability < person_trust(own, 0).probability


def test_each_mark_can_be_usable():
    assert all(is_usable(chance) for mark, chance in probabilities_of(best(), MODELS).items())
