"""Shares of mistakes in what outputs are off by, and each known mistake, told from all others."""

from __future__ import annotations

import numpy as np
import pytest
from stand_ins import stand_in, subject_of

from physic_mock import backends as mocks
from physic_testing.conformance.expect import CheckFailed
from physic_testing.conformance.kit import TABLES
from physic_testing.conformance.readings import compare, reordered, shares, values_of

pytestmark = pytest.mark.quick

GROUPS = [(interface, group) for interface, table in TABLES.items() for group in table.groups]
UNSHOWN = {
    ("joints_are_those_of_the_person", "clipped to the box of the person"),
    ("hands_are_those_of_the_person", "Euler angles"),
    ("touch_is_that_of_the_parts", "with left and right exchanged"),
}
"""Mistakes without effect in photos of worlds: no joint is outside of its box, fingers bend about
one axis, and both sides touch alike.
"""

RNG = np.random.default_rng(0)
MISTAKE = [RNG.normal(size=400) for _ in range(12)]
ERRORS = [RNG.normal(size=400) for _ in range(12)]


@pytest.mark.parametrize("made", [0, 0.5, 1])
def test_the_share_of_a_mistake_is_found_among_other_errors(made):
    off = [made * m + e for m, e in zip(MISTAKE, ERRORS, strict=True)]
    assert np.median(shares(off, MISTAKE)) == pytest.approx(made, abs=0.05)


def test_units_that_do_not_show_a_mistake_say_nothing_of_it():
    mistakes = [MISTAKE[0], 0.001 * MISTAKE[1], np.full(400, np.nan)]
    found = shares(mistakes, mistakes)
    assert found[0] == pytest.approx(1)
    assert np.isnan(found[1:]).all()


def test_what_all_units_have_in_common_does_not_count_if_centred():
    off = [np.array([3.0 + i]) for i in range(4)]
    mistakes = [np.array([float(i)]) for i in range(4)]
    assert shares(off, mistakes, centred=True)[[0, 3]] == pytest.approx(1)
    assert shares(off, mistakes)[3] == pytest.approx(2)


@pytest.fixture(scope="module")
def right():
    """Interface -> a right backend, whose values are kept."""
    kinds = {getattr(mocks, name).interface: name for name in mocks.__all__}
    return {interface: subject_of(stand_in(kinds[interface])) for interface in TABLES}


def said_of(subject, values, group, make):
    """What the check of a group says of outputs that are the truth with a mistake."""
    right = values_of(subject, values)
    subject.values = [
        ({group.key: make(truth[group.key].astype(float), truth)}, truth) for _, truth in right
    ]
    try:
        with pytest.raises(CheckFailed) as caught:
            compare(subject, values, group)
    finally:
        subject.values = right
    return str(caught.value)


def name_of(value):
    """Return the name of an interface, a group of readings or a reading in the name of a test."""
    return getattr(value, "words", getattr(value, "check", value))


@pytest.mark.parametrize(
    ("interface", "group", "reading"),
    [
        (interface, group, reading)
        for interface, group in GROUPS
        for reading in group.readings
        if (group.check, reading.words) not in UNSHOWN
    ],
    ids=name_of,
)
def test_a_mistake_of_twice_its_limit_is_told_from_all_others(right, interface, group, reading):
    times = 2 * reading.limit / reading.size if reading.size else 1.0

    def made(value, truth):
        return value + times * (reading.make(value, truth) - value)

    said = said_of(right[interface], TABLES[interface].values, group, made)
    assert reading.words in said
    assert reading.hint in said


@pytest.mark.parametrize(
    ("interface", "group"), [row for row in GROUPS if row[1].order], ids=name_of
)
def test_parts_in_another_order_are_named(right, interface, group):
    table = TABLES[interface]
    names, axis = group.order
    names = names or values_of(right[interface], table.values)[0][1]["names"]
    order = list(range(len(names)))
    order[4], order[7] = 7, 4
    said = said_of(right[interface], table.values, group, reordered(order, axis))
    assert f"reordered: {names[4]} for {names[7]}" in said
