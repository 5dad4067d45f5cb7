"""Feet in the air are found by the gap of depth behind them, and touch nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from physic_core import engine_preset
from physic_core.engine.joint.solve import optimize
from physic_core.engine.placement.detections import ObservedPeople
from physic_core.engine.stance import Stance, depth_gaps_at_feet, find_lifted_feet, standing_prior

NOBODY, SOMEBODY = torch.tensor([False]), torch.tensor([True])


def above(height, camera=1.5):
    """Gap behind a foot so high over level ground, the camera being 1.5 m over it."""
    return math.log(camera / (camera - height))


def lifted_feet(gap, held=NOBODY, camera=1.5, on_furniture=False, score=math.nan):
    gap = np.asarray(gap, float)
    known = np.full(gap.shape, 0.8)
    stance = Stance(known, gap, np.full(gap.shape, on_furniture), known, np.full(len(gap), score))
    return find_lifted_feet(stance, held, camera)


def found(left, right, held=NOBODY, camera=1.5, **known):
    """Lifted feet and whether the person is in the air."""
    feet = lifted_feet([[left, right]], held, camera, **known)
    return feet[0].tolist(), bool(feet.all())


def test_a_lifted_foot_is_lifted_alone():
    assert found(above(0.2), 0.02) == ([True, False], False)


def test_a_hanging_person_is_in_the_air_by_the_mean_of_both_feet():
    assert found(above(0.1), above(0.3)) == ([False, True], False)
    assert found(above(0.1), above(0.3), SOMEBODY) == ([True, True], True)


def test_a_person_who_lifts_a_weight_with_a_heel_up_stands():
    assert found(above(0.06), above(0.13), SOMEBODY) == ([False, False], False)


def test_feet_among_seats_and_tables_have_no_gap_to_the_floor():
    assert found(above(0.4), above(0.4), on_furniture=True) == ([False, False], False)


def test_a_person_whose_soles_give_the_scene_another_scale_is_in_the_air():
    assert found(math.nan, 0.02, score=-4.0) == ([True, True], True)
    assert found(math.nan, 0.02, score=-2.0) == ([False, False], False)


def test_a_foot_stands_by_its_keypoints_and_by_the_depth_behind_it():
    touch = np.array([[0.8, 0.2]])
    unknown, low, high = (standing_prior(touch, np.full((1, 2), gap), None)[0] for gap in (np.nan, 0.01, 0.3))
    assert (high < unknown).all()
    assert (unknown < low).all()
    assert (unknown[:, 1] < unknown[:, 0]).all()
    assert (standing_prior(touch, np.full((1, 2), np.nan), np.ones((1, 2), bool))[0] < unknown).all()


def test_a_depth_too_near_for_a_foot_in_the_air_is_wrong_and_says_nothing_of_the_foot():
    touch = np.array([[0.8, 0.2]])
    unknown, right = standing_prior(touch, np.full((1, 2), np.nan), None)
    absurd, wrong = standing_prior(touch, np.full((1, 2), 2.3), None)
    assert absurd == pytest.approx(unknown, abs=0.01)
    assert right > 0.9
    assert wrong < 0.01


def test_nothing_is_known_of_unseen_feet():
    assert found(math.nan, math.nan, SOMEBODY) == ([False, False], False)
    assert found(math.nan, above(0.4)) == ([False, True], False)
    assert found(math.nan, above(0.4), SOMEBODY) == ([True, True], True)


def test_ankles_before_a_low_camera_are_not_lifted():
    assert found(0.17, 0.14, camera=0.42) == ([False, False], False)
    assert found(above(0.3, 0.42), 0.0, camera=0.42) == ([True, False], False)


def floor_depth(problem):
    """(H, W) depth of the floor alone."""
    height, width = problem.masks.shape[-2:]
    v, u = torch.meshgrid(torch.arange(height).float(), torch.arange(width).float(), indexing="ij")
    rays = torch.stack([(u - problem.K[0, 2]) / problem.K[0, 0], (v - problem.K[1, 2]) / problem.K[1, 1]], -1)
    return torch.where(rays[..., 1] > 0.02, problem.floor_offset / rays[..., 1], torch.nan)


def gap_of(problem, raised=None):
    """Gaps of depth at the feet before the floor; ``raised`` is True where a label names a seat or a table."""
    scene = floor_depth(problem)
    photo = torch.where(problem.human_depth.isnan(), scene, problem.human_depth)
    raised = torch.zeros_like(problem.masks[0]) if raised is None else raised
    found = ObservedPeople(
        problem.skeleton, problem.keypoints, problem.keypoint_confidence, problem.observed, problem.masks
    )
    return depth_gaps_at_feet(found, photo, scene, raised)


def test_feet_over_the_floor_have_a_gap_and_may_be_among_seats_and_tables(make_stage):
    on_floor, over_it = (make_stage([({}, (0.0, 0.0, 3.0))], stands_at=y).problem for y in (1.3, 1.0))
    assert not lifted_feet(gap_of(on_floor)[0], camera=1.3).all()
    gap, _ = gap_of(over_it)
    assert lifted_feet(gap, camera=1.3).all()
    # The visible foot is a few centimetres higher than its sole.
    assert gap.mean().item() == pytest.approx(above(0.3 + 0.03, 1.3), abs=0.05)
    for raised in (False, True):
        assert bool(gap_of(over_it, torch.full_like(over_it.masks[0], raised))[1].all()) == raised


def test_keypoints_that_are_not_seen_have_no_gap(make_stage):
    problem = make_stage([({}, (0.0, 0.0, 3.0))]).problem
    confidence = problem.keypoint_confidence.clone()
    confidence[:, [j for j, name in enumerate(problem.skeleton.names) if name.startswith("left_")]] = 0.1
    gap, _ = gap_of(replace(problem, keypoint_confidence=confidence))
    assert gap.isnan().tolist() == [[True, False]]


def test_a_lifted_foot_stays_lifted(make_stage):
    """A foot some centimetres over the other one, as estimated: the engine no longer puts it on the floor."""
    lifts = {"left_hip": (-0.6, 0, 0), "left_knee": (0.9, 0, 0), "left_ankle": (-0.3, 0, 0)}
    stage = make_stage([(lifts, (0.0, 0.0, 3.0))])
    sole = stage.problem.model.contact_sets["left_sole"]
    lift = 1.3 - float(stage.vertices[0, sole, 1].max())
    assert 0.05 < lift < 0.15
    problem = replace(stage.problem, keypoint_confidence=0.35 * stage.problem.keypoint_confidence)
    lifted = replace(problem, lifted_feet=torch.tensor([[True, False]]))

    def height(given):
        return 1.3 - float(optimize(given, engine_preset("default").joint).vertices[0, sole, 1].max())

    assert height(lifted) > max(0.6 * lift, height(problem))
    touching = problem.feet_in_air()
    assert not touching.any()
    assert lifted.feet_in_air()[0, sole].all()
