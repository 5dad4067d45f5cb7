"""Whether feet, hands and seat touch something, by keypoints and by what is observed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from physic_core import engine_preset
from physic_core.engine.ground.stance import (
    Stance,
    depth_gaps_at_feet,
    foot_drops,
    stance_in_picture,
    standing_prior,
)
from physic_core.engine.ground.touch import LEAST_PROBABILITY
from physic_core.engine.joint.solve import optimize
from physic_core.geometry.camera import pixel_rays
from physic_core.types import Keypoints, Observations

from .conftest import FLOOR_Y

NAMES = tuple(
    f"{side}_{part}"
    for side in ("left", "right")
    for part in ("shoulder", "hip", "ankle", "heel", "foot_tip", "wrist")
)

STANDS = {
    "shoulder": (0, 0),
    "hip": (0, 100),
    "ankle": (0, 265),
    "heel": (-5, 272),
    "foot_tip": (15, 280),
    "wrist": (10, 100),
}
RAISED = {"ankle": (0, 195), "heel": (-2, 180), "foot_tip": (2, 205)}


def person(left=None, both=None):
    """Keypoints (1, 12, 2) of a person who stands, seen from the front, one or both sides
    changed.
    """
    sides = STANDS | (both or {}) | (left or {}), STANDS | (both or {})
    points = np.array([list(side.values()) for side in sides], np.float64)
    points[..., 0] += [[20], [-20]]
    return points.reshape(1, -1, 2)


def observed(*touch):
    """Observations of one person: probabilities of feet, hands and seat, of a share of one half."""
    unknown = Observations.unknown(1)
    half = np.full(5, 0.5, np.float32)
    return replace(unknown, touch=np.array([touch], np.float32), touch_share=half)


def touch_of(points, names=NAMES, said=None):
    """Probability that feet touch, (N, 2)."""
    return stance_in_picture(points, names, said or Observations.unknown(len(points))).touch[:, :2]


def test_both_feet_of_people_who_stand_touch_and_one_raised_behind_touches_less():
    assert (touch_of(person()) > 0.6).all()
    raised, other = touch_of(person(left=RAISED))[0]
    assert raised < other
    assert touch_of(np.zeros((0, 12, 2))).shape == (0, 2)


def test_the_height_of_feet_is_in_lengths_of_the_trunk_at_any_size_of_the_picture():
    lower = foot_drops(7.0 * person(left=RAISED), NAMES)
    assert lower.tolist() == pytest.approx(np.array([[-0.75, 0.75]]))


def test_mirrored_people_have_mirrored_feet():
    points = person(left=RAISED)
    mirrored = np.concatenate([points[:, 6:], points[:, :6]], 1) * [-1, 1]
    assert touch_of(mirrored) == pytest.approx(touch_of(points)[:, ::-1])


@pytest.mark.parametrize("unknown", ["nan", "names"])
def test_legs_without_keypoints_are_those_of_an_average_foot(unknown):
    points = person(left=RAISED)
    names = NAMES
    if unknown == "nan":
        points[0, 2] = np.nan
    else:
        names = tuple(name.replace("heel", "sole") for name in NAMES)
    assert np.isnan(foot_drops(points, names)).all()
    found = touch_of(points, names)[0]
    assert found[0] == found[1]
    assert 0.5 < found[0] < 0.97


def test_what_is_observed_of_a_part_moves_its_touch_and_no_other():
    nothing = math.nan
    average = stance_in_picture(person(), NAMES, Observations.unknown(1)).touch[0]
    for column in range(5):
        for sure in (0.03, 0.97):
            said = np.full(5, nothing)
            said[column] = sure
            found = stance_in_picture(person(), NAMES, observed(*said)).touch[0]
            assert (found[column] > average[column]) == (sure > 0.5)
            assert np.delete(found, column).tolist() == np.delete(average, column).tolist()


NOWHERE = np.zeros((1, 2), bool)


def prior(gap, raised=NOWHERE):
    return standing_prior(np.array([[0.8, 0.2]]), np.full((1, 2), gap), raised)


def test_a_foot_stands_by_its_touch_and_by_the_depth_behind_it():
    unknown, low, high = (prior(gap)[0] for gap in (np.nan, 0.01, 0.3))
    assert (high < unknown).all()
    assert (unknown < low).all()
    assert (unknown[:, 1] < unknown[:, 0]).all()
    assert (prior(np.nan, np.ones((1, 2), bool))[0] < unknown).all()


def test_a_gap_too_large_for_a_lifted_foot_makes_the_depth_wrong_and_not_the_foot():
    absurd, wrong = prior(2.3)
    assert absurd == pytest.approx(prior(np.nan)[0], abs=0.01)
    assert wrong < 0.01
    assert prior(0.02)[1] > 0.9


def test_feet_of_people_who_ride_are_not_on_the_floor():
    walks, rides = (
        standing_prior(np.array([[0.9, 0.9]]), np.full((1, 2), np.nan), NOWHERE, np.array([p]))[0]
        for p in (0.0, 0.95)
    )
    assert rides.max() < 0.1 * walks.min()


def test_people_with_both_feet_probably_off_the_ground_are_in_the_air():
    one_raised = np.array([[0.0, 0.0], [-1.0, 1.0], [0.0, 0.0]])
    said = np.zeros((3, 5))
    said[2, :2] = -6.0
    stance = replace(Stance.unknown(3), lower=one_raised, observed=said)
    off = (stance.touch[:, :2] < LEAST_PROBABILITY).all(1)
    assert off.tolist() == [False, False, True]


def test_people_without_a_body_have_average_feet():
    known = replace(Stance.unknown(1), lower=np.array([[-0.5, 0.5]]), observed=np.full((1, 5), 0.2))
    wider = known.expanded(np.array([False, True]))
    assert wider.touch[1].tolist() == known.touch[0].tolist()
    assert wider.touch[0].tolist() == Stance.unknown(1).touch[0].tolist()


def floor_depth(state):
    """(H, W) depth of the floor alone."""
    down = pixel_rays(*state.masks.shape[-2:], state.K)[..., 1]
    return torch.where(down > 0.02, state.scene.floor.offset / down, torch.nan)


def people_of(state):
    """Keypoints and masks of a problem, and the depth (H, W) of the photo."""
    photo = torch.where(state.photo_depth.isnan(), floor_depth(state), state.photo_depth)
    points = state.keypoints.numpy()
    confidence = state.keypoint_confidence.numpy()
    return Keypoints(points, confidence, state.skeleton), state.masks, photo


def test_feet_over_the_floor_have_a_gap_and_may_be_among_seats_and_tables(make_stage):
    on_floor, over_it = (make_stage([({}, (0.0, 0.0, 3.0))], stands_at=y).state for y in (1.3, 1.0))
    low, high = (
        depth_gaps_at_feet(*people_of(p), floor_depth(p), torch.zeros_like(p.masks[0]))[0]
        for p in (on_floor, over_it)
    )
    assert low.max() < 0.1
    # The visible foot is a few centimetres higher than its sole.
    assert high.mean() == pytest.approx(math.log(1.3 / (1.3 - 0.33)), abs=0.05)
    for raised in (False, True):
        labels = torch.full_like(over_it.masks[0], raised)
        _, among = depth_gaps_at_feet(*people_of(over_it), floor_depth(over_it), labels)
        assert bool(among.all()) == raised


def test_keypoints_that_are_not_seen_have_no_gap(make_stage):
    state = make_stage([({}, (0.0, 0.0, 3.0))]).state
    left = torch.tensor([name.startswith("left_") for name in state.skeleton.names])
    unseen = replace(state, keypoint_confidence=torch.where(left, 0.1, state.keypoint_confidence))
    nowhere = torch.zeros_like(state.masks[0])
    gap, _ = depth_gaps_at_feet(*people_of(unseen), floor_depth(state), nowhere)
    assert np.isnan(gap).tolist() == [[True, False]]


def test_a_foot_that_hardly_touches_stays_lifted(make_stage):
    """A foot some centimetres over the other one, as estimated: the engine no longer puts it on the
    floor.
    """
    lifts = {"left_hip": (-0.6, 0, 0), "left_knee": (0.9, 0, 0), "left_ankle": (-0.3, 0, 0)}
    stage = make_stage([(lifts, (0.0, 0.0, 3.0))])
    sole = stage.state.model.contact_sets["left_sole"]

    def height(vertices):
        return FLOOR_Y - float(vertices[0, sole, 1].max())

    lift = height(stage.vertices)
    assert 0.05 < lift < 0.15
    state = replace(stage.state, keypoint_confidence=0.35 * stage.state.keypoint_confidence)
    known = replace(state, touch=torch.tensor([[0.0, 1.0, 1.0, 1.0, 1.0]]))
    plain, lifted = (
        height(optimize(given, engine_preset("default").joint).vertices) for given in (state, known)
    )
    assert lifted > max(0.6 * lift, plain)
