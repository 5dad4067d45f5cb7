"""Which feet touch something, by the keypoints of the legs in the picture."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.body.feet_in_picture import foot_features, foot_touch_probability

NAMES = tuple(
    f"{side}_{part}" for side in ("left", "right") for part in ("shoulder", "hip", "knee", "ankle", "heel", "foot_tip")
)
STANDS = {
    "shoulder": (0, 0),
    "hip": (0, 100),
    "knee": (0, 185),
    "ankle": (0, 265),
    "heel": (-5, 272),
    "foot_tip": (15, 280),
}


def person(left: dict[str, tuple[float, float]] | None = None, right: dict[str, tuple[float, float]] | None = None):
    """Keypoints (1, 12, 2) of a person who stands, seen from the front, with some of them elsewhere."""
    points = []
    for x, changed in ((20, left), (-20, right)):
        points += [(x + u, v) for u, v in (STANDS | (changed or {})).values()]
    return np.array(points, np.float64)[None]


def test_both_feet_of_a_person_who_stands_touch():
    found = foot_touch_probability(person(), NAMES)
    assert found.shape == (1, 2)
    assert (found > 0.8).all()


def test_a_foot_that_is_raised_behind_touches_less_than_the_other():
    raised = {"ankle": (0, 195), "heel": (-2, 180), "foot_tip": (2, 205)}
    found = foot_touch_probability(person(left=raised), NAMES)[0]
    assert found[0] < 0.3
    assert found[1] > 0.8


def test_the_features_are_lengths_of_the_trunk():
    lower, heel, shin, bend = foot_features(
        person(right={"ankle": (0, 245), "heel": (-5, 252), "foot_tip": (15, 260)}), NAMES
    )[0, 0]
    assert lower == pytest.approx(0.2)
    assert heel == pytest.approx(-0.08)
    assert shin == pytest.approx(0.6)
    assert bend == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("factor", [0.1, 7.0])
def test_the_size_of_the_picture_does_not_matter(factor):
    points = person(left={"ankle": (0, 230)})
    assert foot_touch_probability(factor * points, NAMES) == pytest.approx(foot_touch_probability(points, NAMES))


def test_mirrored_people_have_mirrored_feet():
    points = person(left={"ankle": (0, 230), "foot_tip": (15, 240)})
    mirrored = np.concatenate([points[:, 6:], points[:, :6]], 1) * [-1, 1]
    assert foot_touch_probability(mirrored, NAMES) == pytest.approx(foot_touch_probability(points, NAMES)[:, ::-1])


@pytest.mark.parametrize("unknown", ["nan", "names"])
def test_legs_without_keypoints_are_those_of_an_average_foot(unknown):
    points, names = person(), NAMES
    if unknown == "nan":
        points[0, 3] = np.nan
    else:
        names = tuple(name.replace("heel", "sole") for name in NAMES)
    found = foot_touch_probability(points, names)
    assert np.isnan(foot_features(points, names)).all()
    assert found[0, 0] == found[0, 1]
    assert 0.7 < found[0, 0] < 0.95


def test_nobody_has_no_feet():
    assert foot_touch_probability(np.zeros((0, 12, 2)), NAMES).shape == (0, 2)
