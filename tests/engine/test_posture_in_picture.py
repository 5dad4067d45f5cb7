"""Who is upright, by the picture and the person observer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_core.engine.ground.posture import trunk_in_picture_deg, upright_people
from physic_core.types import SKELETONS, Keypoints, Observations
from physic_core.types.observations import POSTURES

NAMES = SKELETONS["coco17"].names


def keypoints_of(degrees):
    """A trunk whose shoulders lie at an angle from up in the picture, clockwise."""
    points = np.full((1, 17, 2), 50.0)
    for side in ("left", "right"):
        way = np.array([np.sin(np.radians(degrees)), -np.cos(np.radians(degrees))])
        points[0, NAMES.index(f"{side}_shoulder")] += 20 * way
    return Keypoints(points, np.ones((1, 17)), "coco17")


def observed_as(posture):
    sure = np.array([[name == posture for name in POSTURES]], np.float32)
    return replace(Observations.unknown(1), posture=sure)


@pytest.mark.parametrize("degrees", [0.0, 30.0, -60.0, 150.0])
def test_the_angle_of_a_trunk_in_the_picture_is_clockwise_from_up(degrees):
    assert trunk_in_picture_deg(keypoints_of(degrees).points, NAMES) == pytest.approx(degrees)


@pytest.mark.parametrize(
    ("degrees", "posture", "upright"),
    [
        (10.0, "stand", True),
        (10.0, "sit", True),
        (10.0, None, True),
        (10.0, "squat", False),
        (10.0, "lie", False),
        (80.0, "stand", False),
        (180.0, None, False),
        (np.nan, "stand", True),
    ],
)
def test_people_are_upright_unless_picture_or_observer_says_otherwise(degrees, posture, upright):
    said = Observations.unknown(1) if posture is None else observed_as(posture)
    assert upright_people(keypoints_of(degrees), said).tolist() == [upright]
