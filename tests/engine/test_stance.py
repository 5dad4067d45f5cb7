"""Whether feet touch something, by their keypoints and by the depth beside them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from physic_core import engine_preset
from physic_core.engine.joint.solve import optimize
from physic_core.engine.stance import (
    Stance,
    depth_beside,
    depth_gaps_at_feet,
    hanging_posture,
    lower_than_the_other,
    standing_prior,
    touch_in_picture,
)
from physic_core.geometry.camera import pixel_rays
from physic_core.types import Keypoints

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


def touch(lower=(math.nan, math.nan), beside=(math.nan, math.nan)):
    """Probability that both feet touch."""
    parts = np.array([(*beside, math.nan, math.nan, math.nan)])
    return replace(Stance.unknown(1), lower=np.array([lower]), beside=parts).touch[0]


def test_both_feet_of_people_who_stand_touch_and_one_raised_behind_touches_less():
    assert (touch_in_picture(person(), NAMES) > 0.6).all()
    raised, other = touch_in_picture(person(left=RAISED), NAMES)[0]
    assert raised < other
    assert touch_in_picture(np.zeros((0, 12, 2)), NAMES).shape == (0, 2)


def test_the_height_of_feet_is_in_lengths_of_the_trunk_at_any_size_of_the_picture():
    lower = lower_than_the_other(7.0 * person(left=RAISED), NAMES)
    assert lower.tolist() == pytest.approx(np.array([[-0.75, 0.75]]))


def test_mirrored_people_have_mirrored_feet():
    points = person(left=RAISED)
    mirrored = np.concatenate([points[:, 6:], points[:, :6]], 1) * [-1, 1]
    assert touch_in_picture(mirrored, NAMES) == pytest.approx(
        touch_in_picture(points, NAMES)[:, ::-1]
    )


@pytest.mark.parametrize("unknown", ["nan", "names"])
def test_legs_without_keypoints_are_those_of_an_average_foot(unknown):
    points = person(left=RAISED)
    names = NAMES
    if unknown == "nan":
        points[0, 2] = np.nan
    else:
        names = tuple(name.replace("heel", "sole") for name in NAMES)
    assert np.isnan(lower_than_the_other(points, names)).all()
    found = touch_in_picture(points, names)[0]
    assert found[0] == found[1]
    assert 0.5 < found[0] < 0.97


ARMS_UP = {"wrist": (5, -90)}
TOES_DOWN = {"foot_tip": (0, 300)}


@pytest.mark.parametrize(
    ("changed", "posture"),
    [
        ({}, 0.0),
        (ARMS_UP, 0.4),
        (TOES_DOWN, 0.0),
        (ARMS_UP | TOES_DOWN, 1.0),
        ({"wrist": (5, -40)} | TOES_DOWN, 0.5),
    ],
)
def test_people_hang_if_both_arms_are_raised_and_the_toes_point_down(changed, posture):
    points = person(both=changed)
    found = hanging_posture(3.0 * points, NAMES)
    assert found.tolist() == pytest.approx([posture])
    lowered = person(both={**changed, "wrist": STANDS["wrist"]})
    assert (touch_in_picture(points, NAMES) < touch_in_picture(lowered, NAMES)).all() == (
        posture > 0
    )


def test_a_person_who_raises_one_arm_does_not_hang():
    assert hanging_posture(person(left=ARMS_UP | TOES_DOWN), NAMES).tolist() == [0.0]


def test_a_foot_with_only_larger_depths_beside_it_touches_less():
    average = touch()[0]
    near, far = touch(beside=(0.01, 0.3))
    assert far < average < near
    assert touch(beside=(0.3, 0.9)).tolist() == [far, far]


def prior(gap, raised=None):
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


def test_people_with_both_feet_probably_off_the_ground_are_in_the_air():
    lower = np.array([[0.0, 0.0], [-1.0, 1.0], [0.0, 0.0]])
    beside = np.array([[0.01] * 5, [0.01] * 5, [0.3] * 5])
    stance = replace(Stance.unknown(3), lower=lower, beside=beside)
    assert stance.in_air.tolist() == [False, False, True]


def test_people_without_a_body_have_average_feet():
    known = replace(Stance.unknown(1), lower=np.array([[-0.5, 0.5]]), beside=np.full((1, 5), 0.2))
    wider = known.expanded(np.array([False, True]))
    assert wider.touch[1].tolist() == known.touch[0].tolist()
    assert wider.touch[0].tolist() == touch().tolist()


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


def test_depth_beside_feet_on_the_floor_is_theirs_and_is_larger_behind_lifted_feet(make_stage):
    on_floor, over_it = (
        depth_beside(*people_of(make_stage([({}, (0.0, 0.0, 3.0))], stands_at=y).state))[0]
        for y in (1.3, 0.9)
    )
    assert on_floor[:2].max() < 0.06
    assert over_it[:2].min() > 0.15


def test_nothing_is_known_beside_parts_without_keypoints_or_depth(make_stage):
    keypoints, masks, photo = people_of(make_stage([({}, (0.0, 0.0, 3.0))]).state)
    left = [[name.startswith("left_")] for name in keypoints.joint_set.names]
    points = np.where(left, math.nan, keypoints.points)
    found = depth_beside(replace(keypoints, points=points), masks, photo)
    assert np.isnan(found[0]).tolist()[::2] == [True, True, False]
    assert np.isnan(depth_beside(keypoints, masks, torch.full_like(photo, math.nan))).all()


def test_feet_over_the_floor_have_a_gap_and_may_be_among_seats_and_tables(make_stage):
    on_floor, over_it = (make_stage([({}, (0.0, 0.0, 3.0))], stands_at=y).state for y in (1.3, 1.0))
    low, high = (
        depth_gaps_at_feet(*people_of(p), floor_depth(p), None)[0] for p in (on_floor, over_it)
    )
    assert low.max() < 0.1
    # The visible foot is a few centimetres higher than its sole.
    assert high.mean().item() == pytest.approx(math.log(1.3 / (1.3 - 0.33)), abs=0.05)
    for raised in (False, True):
        labels = torch.full_like(over_it.masks[0], raised)
        _, among = depth_gaps_at_feet(*people_of(over_it), floor_depth(over_it), labels)
        assert bool(among.all()) == raised


def test_keypoints_that_are_not_seen_have_no_gap(make_stage):
    state = make_stage([({}, (0.0, 0.0, 3.0))]).state
    left = torch.tensor([name.startswith("left_") for name in state.skeleton.names])
    unseen = replace(state, keypoint_confidence=torch.where(left, 0.1, state.keypoint_confidence))
    gap, _ = depth_gaps_at_feet(*people_of(unseen), floor_depth(state), None)
    assert gap.isnan().tolist() == [[True, False]]


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
    known = replace(state, foot_touch=torch.tensor([[0.0, 1.0]]))
    plain, lifted = (
        height(optimize(given, engine_preset("default").joint).vertices) for given in (state, known)
    )
    assert lifted > max(0.6 * lift, plain)
