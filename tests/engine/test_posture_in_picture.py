"""Who is upright, and who is seen from behind, by the picture and the person observer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_core.engine.ground.posture import (
    is_upright,
    seems_reversed,
    weigh_posture,
)
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
    assert is_upright(keypoints_of(degrees), said).tolist() == [upright]


def unsure():
    """Observations of one person who sits more probably than lies."""
    posture = np.full((1, 9), 0.02, np.float32)
    share = np.full(9, 0.12, np.float32)
    posture[0, POSTURES.index("sit")], share[POSTURES.index("lie")] = 0.84, 0.01
    return replace(Observations.unknown(1), posture=posture, posture_share=share)


def test_a_trunk_across_the_picture_makes_it_likely_that_a_person_lies():
    upright, across = (weigh_posture(unsure(), keypoints_of(d)).posture[0] for d in (20.0, -85.0))
    np.testing.assert_allclose(upright, unsure().posture[0], atol=1e-6)
    assert POSTURES[int(across.argmax())] == "lie"
    assert across.sum() == pytest.approx(1.0, abs=1e-5)


def test_who_bends_over_a_leg_that_carries_the_hips_does_not_lie():
    lying = keypoints_of(-85.0)
    bent = replace(lying, points=lying.points.copy())
    for joint, below in (("knee", 20), ("ankle", 40)):
        bent.points[0, NAMES.index(f"left_{joint}"), 1] += below
    standing = replace(unsure(), posture=np.roll(unsure().posture, -POSTURES.index("sit")))
    said = [weigh_posture(standing, k).posture[0, POSTURES.index("lie")] for k in (lying, bent)]
    assert said[0] > 0.5 > 0.1 > said[1]


def test_observations_that_say_nothing_stay_so():
    assert np.isnan(weigh_posture(Observations.unknown(1), keypoints_of(80.0)).posture).all()


@pytest.mark.parametrize(
    ("yaw", "away", "found"),
    [
        (0.0, 0.99, True),
        (-50.0, 0.99, True),
        (0.0, 0.6, False),
        (70.0, 0.99, False),
        (180.0, 0.99, False),
        (0.0, np.nan, False),
        (np.nan, 0.99, False),
        (None, 0.99, False),
    ],
)
def test_a_back_is_taken_for_a_front_where_3d_keypoints_surely_contradict_the_observer(
    yaw, away, found
):
    keypoints = keypoints_of(0.0)
    if yaw is not None:
        world = np.zeros((1, 17, 3))
        for side, sign in (("left", 0.2), ("right", -0.2)):
            for joint in ("shoulder", "hip"):
                way = [np.cos(np.radians(yaw)), 0.0, np.sin(np.radians(yaw))]
                world[0, NAMES.index(f"{side}_{joint}")] = sign * np.array(way)
        keypoints = replace(keypoints, world=world)
    said = replace(Observations.unknown(1), away=np.array([away], np.float32), away_share=0.15)
    assert seems_reversed(said, keypoints).tolist() == [found]
