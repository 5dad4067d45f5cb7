"""A metric depth with a scale of its own in a whole run: its metres count beside the sizes of
people.
"""

from __future__ import annotations

import numpy as np
import pytest

from physic_core import KnownSizes
from physic_core.errors import ConfigError
from tests.pipeline.mocks import run

pytestmark = pytest.mark.usefixtures("few_steps")

EXACT = [
    f"{name}.options.noise=0" for name in ("metric_depth", "relative_pointmap", "body_estimator")
]


def camera_height(result, world):
    return result.scene.floor.offset / world.floor.offset


def measured(world, scale, *settings):
    """The result with a depth that counts as measured, times a scale."""
    depth = ("metric_depth.options.stated_sigma=0.01", f"metric_depth.options.scale={scale}")
    return run(world.image, *EXACT, *depth, *settings)


def test_a_measured_depth_gives_the_metres_whatever_the_size_of_the_bodies(world):
    larger = ("body_estimator.options.noise=1", "body_estimator.options.stature_bias=0.15")
    found = measured(world, 1, *larger)
    assert camera_height(found, world) == pytest.approx(1, abs=0.04)
    assert any("measured depth sets the scale" in note for note in found.notes)


def test_people_follow_a_measured_depth(world):
    one, larger = (measured(world, scale) for scale in (1, 1.15))
    assert camera_height(larger, world) / camera_height(one, world) == pytest.approx(
        1.15, abs=0.015
    )
    for before, after in zip(one.people, larger.people, strict=True):
        assert after.stature / before.stature == pytest.approx(1.15, abs=0.05)
    assert larger.scene.scale_sigma == pytest.approx(0.01, abs=0.005)


def test_a_measured_depth_that_people_contradict_is_followed_with_a_warning(world):
    found = measured(world, 0.65)
    assert camera_height(found, world) == pytest.approx(0.65, abs=0.03)
    assert any("your depth" in warning for warning in found.warnings)
    assert found.usable["place"] == found.usable["size"] == 0


@pytest.mark.parametrize(
    ("scale", "unit"),
    [
        (5000, "1/5000 m"),
        (1000, "millimeters"),
        (3.281, "feet"),
        (0.1, "centimeters"),
        (0.2, "optical axis"),
    ],
)
def test_a_depth_by_which_people_are_no_people_is_refused_with_its_likely_unit(world, scale, unit):
    with pytest.raises(ConfigError, match=unit):
        measured(world, scale)


def test_people_correct_a_metric_depth_that_is_far_off(world):
    found = run(world.image, *EXACT, "metric_depth.options.scale=2")
    assert camera_height(found, world) == pytest.approx(1, abs=0.1)
    assert any("by 0.5" in note for note in found.notes)


def test_a_known_age_makes_sizes_more_certain(world):
    found = run(world.image, *EXACT)
    assert all(0.1 < person.stature_sigma < 0.15 for person in found.people)
    given = run(world.image, *EXACT, known=KnownSizes(age=(40.0,)))
    assert all(person.stature_sigma < 0.07 for person in given.people)
    assert np.all(np.array(given.distance_sigmas) <= found.distance_sigmas)
