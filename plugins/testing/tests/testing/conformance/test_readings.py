"""Each known mistake is told from all others, alone and among the errors of a network."""

from __future__ import annotations

import numpy as np
import pytest
from stand_ins import stand_in, subject_of

from physic_mock import backends as mocks
from physic_testing.conformance.cases import SIZE as STANDARD_SIZE
from physic_testing.conformance.expect import CheckFailed
from physic_testing.conformance.known_mistakes import compare, values_of
from physic_testing.conformance.tables import TABLES

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

ORDERED = {
    "joints_are_those_of_the_person": 1,
    "pose_is_not_turned_or_mirrored": 1,
    "joints_turn_as_in_the_photo": 1,
    "hands_are_those_of_the_person": 2,
}
"""Check -> the axis of parts whose order it tells."""

LOST = {
    ("metric_depth", "disparity"),
    ("metric_depth", "along the ray of each pixel"),
    ("keypoint_detector", "to the right"),
    ("keypoint_detector", "down"),
    ("keypoint_detector", "too large along x"),
    ("body_estimator", "of the camera of a crop that looks at the person"),
    ("body_estimator", "degrees about y"),
    ("contact_prior", "mirrored"),
    ("contact_prior", "with the own body's"),
}
"""Mistakes that are lost among errors as large as those of a network."""

UNTOLD = {"world_points_are_metres", "wrists_are_in_the_cameras_frame"}
"""Checks of what no mock says."""


@pytest.fixture(scope="module")
def right():
    return subjects()


@pytest.fixture(scope="module")
def noisy():
    return subjects(noise=1, seed=1000, size=STANDARD_SIZE)


def subjects(**settings):
    """Interface -> a backend without a mistake, whose values are kept."""
    kinds = {getattr(mocks, name).interface: name for name in mocks.__all__}
    return {name: subject_of(stand_in(kinds[name]), **settings) for name in TABLES}


def text_of(subject, group, make, *, exact=True):
    """What the check of a group says of outputs with a mistake, which are else the truth, or the
    subject's.
    """
    kept = values_of(subject)
    key = group.key
    subject.values = [
        (
            answered
            | {key: (0 if exact else answered[key] - truth[key]) + make(1.0 * truth[key], truth)},
            truth,
        )
        for answered, truth in kept
    ]
    try:
        with pytest.raises(CheckFailed) as caught:
            compare(subject, group)
    finally:
        subject.values = kept
    return str(caught.value)


def name_of(value):
    """Return the name of an interface, a group of readings or a reading in the name of a test."""
    return getattr(value, "words", getattr(value, "check", value))


READINGS = [
    (interface, group, reading)
    for interface, group in GROUPS
    for reading in group.readings
    if (group.check, reading.words) not in UNSHOWN
]


def of_twice_its_limit(reading):
    times = 2 * reading.limit / reading.size if reading.size else 1.0
    return lambda value, truth: value + times * (reading.make(value, truth) - value)


@pytest.mark.parametrize(("interface", "group", "reading"), READINGS, ids=name_of)
def test_a_mistake_of_twice_its_limit_is_told_from_all_others(right, interface, group, reading):
    mistake = of_twice_its_limit(reading)
    text = text_of(right[interface], group, mistake)
    assert reading.words in text
    assert reading.hint in text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("interface", "group", "reading"),
    [
        (interface, group, reading)
        for interface, group, reading in READINGS
        if (interface, reading.words) not in LOST and group.check not in UNTOLD
    ],
    ids=name_of,
)
def test_a_mistake_is_found_among_the_errors_of_a_network(noisy, interface, group, reading):
    mistake = of_twice_its_limit(reading)
    text_of(noisy[interface], group, mistake, exact=False)


@pytest.mark.parametrize(
    ("interface", "group", "axis"),
    [(*row, ORDERED[row[1].check]) for row in GROUPS if row[1].check in ORDERED],
    ids=name_of,
)
def test_parts_in_another_order_are_named(right, interface, group, axis):
    def exchanged(value, truth):
        order = np.arange(value.shape[axis])
        order[[4, 7]] = 7, 4
        return value.take(order, axis)

    text = text_of(right[interface], group, exchanged)
    assert "reordered: " in text


def test_vertices_that_begin_elsewhere_are_counted(right):
    group = TABLES["contact_prior"].groups[0]
    text = text_of(right["contact_prior"], group, lambda p, _: np.roll(p, 37, 1))
    assert "37 vertices farther on" in text
