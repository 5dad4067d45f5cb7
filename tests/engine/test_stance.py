"""Whether feet, hands and seat touch something, by what is observed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch

from physic_core import engine_preset
from physic_core.engine.ground.stance import Stance
from physic_core.engine.joint.solve import optimize

from .conftest import FLOOR_Y
from .touching import LIMBS, observations


def observed(touch):
    """Observations of one person: whether feet, hands and seat touch the world; NaN is not said."""
    said = {part: ("world", p) for part, p in zip(LIMBS, touch, strict=True) if p == p}
    return observations(**said)


def touch_of(said):
    return Stance.in_picture(said).limb_touch_probability


def test_feet_of_which_nothing_is_said_are_those_of_an_average_person():
    feet = Stance.unknown(2).limb_touch_probability[:, :2]
    assert 0.5 < feet.min() == feet.max() < 0.97
    assert Stance.unknown(0).limb_touch_probability.shape == (0, 5)


def test_what_is_observed_of_a_part_moves_its_touch_and_no_other():
    average = Stance.unknown(1).limb_touch_probability[0]
    for column in range(5):
        for sure in (0.03, 0.97):
            said = np.full(5, math.nan)
            said[column] = sure
            found = touch_of(observed(said))[0]
            assert (found[column] > average[column]) == (sure > 0.5)
            assert np.delete(found, column).tolist() == np.delete(average, column).tolist()


def test_a_low_hand_that_holds_something_does_not_rest():
    said = observations(**dict.fromkeys(LIMBS, ("world", 0.3)) | {"left_hand": ("object", 0.95)})
    stance = replace(Stance.in_picture(said), rest_probability=np.array([0.9]))
    assert stance.holds.tolist() == [[True, False]]
    found = stance.with_resting(np.ones((1, 4), bool)).limb_touch_probability[0]
    assert (found[:4] > stance.limb_touch_probability[0, :4]).tolist() == [True, True, False, True]


def test_feet_that_touch_something_else_do_not_stand_on_the_floor():
    half = np.full(2, 0.5, np.float32)
    stands, rides = (
        Stance.in_picture(
            replace(observed([0.9] * 5), on_floor=np.full((1, 2), p), on_floor_share=half)
        )
        for p in (0.9, 0.05)
    )
    assert stands.limb_touch_probability.tolist() == rides.limb_touch_probability.tolist()
    assert rides.stand_probability.max() < 0.25 * stands.stand_probability.min()


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
    known = replace(state, limb_touch_probability=torch.tensor([[0.0, 1.0, 1.0, 1.0, 1.0]]))
    plain, lifted = (
        height(optimize(given, engine_preset("default").joint).vertices) for given in (state, known)
    )
    assert lifted > max(0.6 * lift, plain)
