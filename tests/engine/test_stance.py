"""Whether feet, hands and seat touch something, by what is observed and by depth."""

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
    standing_prior,
)
from physic_core.engine.joint.solve import optimize
from physic_core.geometry.camera import pixel_rays
from physic_core.types import Keypoints, Observations

from .conftest import FLOOR_Y


def observed(touch):
    """Observations of one person: probabilities of feet, hands and seat, of a share of one half."""
    half = np.full(5, 0.5, np.float32)
    unknown = Observations.unknown(1)
    return replace(unknown, touch=np.array([touch], np.float32), touch_share=half)


def touch_of(said):
    return Stance.in_picture(said).limb_touch


def test_feet_of_which_nothing_is_said_are_those_of_an_average_person():
    feet = Stance.unknown(2).limb_touch[:, :2]
    assert 0.5 < feet.min() == feet.max() < 0.97
    assert Stance.unknown(0).limb_touch.shape == (0, 5)


def test_what_is_observed_of_a_part_moves_its_touch_and_no_other():
    average = Stance.unknown(1).limb_touch[0]
    for column in range(5):
        for sure in (0.03, 0.97):
            said = np.full(5, math.nan)
            said[column] = sure
            found = touch_of(observed(said))[0]
            assert (found[column] > average[column]) == (sure > 0.5)
            assert np.delete(found, column).tolist() == np.delete(average, column).tolist()


@pytest.mark.parametrize(("rests", "moved"), [(0.8, True), (0.3, False), (math.nan, False)])
def test_low_limbs_of_who_rests_on_the_lowest_skin_touch(rests, moved):
    stance = replace(Stance.in_picture(observed(np.full(5, 0.3))), rests=np.array([rests]))
    found = stance.with_resting(np.array([[True, False, True, False]])).limb_touch[0]
    before = stance.limb_touch[0]
    assert found[[1, 3, 4]].tolist() == before[[1, 3, 4]].tolist()
    wanted = 1 - (1 - before[[0, 2]]) * (1 - rests * moved) if moved else before[[0, 2]]
    assert found[[0, 2]] == pytest.approx(wanted)


def test_a_low_hand_that_holds_something_does_not_rest():
    said = replace(
        observed(np.full(5, 0.3)),
        holds=np.array([[0.9, 0.1]], np.float32),
        holds_share=np.full(2, 0.4, np.float32),
    )
    stance = replace(Stance.in_picture(said), rests=np.array([0.9]))
    assert stance.holds.tolist() == [[True, False]]
    found = stance.with_resting(np.ones((1, 4), bool)).limb_touch[0]
    assert (found[:4] > stance.limb_touch[0, :4]).tolist() == [True, True, False, True]


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


def test_people_without_a_body_have_average_feet():
    known = Stance.in_picture(observed([0.2] * 5))
    wider = known.expanded(np.array([False, True]))
    assert wider.limb_touch[1].tolist() == known.limb_touch[0].tolist()
    assert wider.limb_touch[0].tolist() == Stance.unknown(1).limb_touch[0].tolist()


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
    known = replace(state, limb_touch=torch.tensor([[0.0, 1.0, 1.0, 1.0, 1.0]]))
    plain, lifted = (
        height(optimize(given, engine_preset("default").joint).vertices) for given in (state, known)
    )
    assert lifted > max(0.6 * lift, plain)
