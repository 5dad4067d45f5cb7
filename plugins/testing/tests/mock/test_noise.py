"""The errors of the mocks have the sizes that README.md states, and grow with one common factor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from physic_core.body import load_body
from physic_core.types import Hints, People
from physic_mock.backends import (
    MockBodyEstimator,
    MockKeypointDetector,
    MockSegmenter,
)
from physic_mock.bodies_and_hands import log_stature_gradient
from physic_testing.worlds import load_world


@pytest.fixture(scope="module")
def world():
    return load_world("stand")


def people_of(world):
    return People(world.masks, world.boxes, np.full(len(world.masks), 0.9), None)


def bodies_of(world, camera=None, **options):
    people = people_of(world)
    keypoints = MockKeypointDetector().infer(world.image, people)
    estimator = MockBodyEstimator(**options)
    return estimator.infer(world.image, people, camera or world.intrinsics, keypoints, Hints())


def test_ragged_masks_stay_near_the_truth():
    world = load_world("hug")
    for seed in range(5):
        people = MockSegmenter(noise=1, noise_seed=seed, missed_people=0).infer(world.image)
        for mask, truth in zip(people.masks, world.masks, strict=True):
            assert 0.7 < (mask & truth).sum() / (mask | truth).sum() < 0.995


def test_a_wrong_focal_length_moves_bodies_along_the_ray_of_their_pixels(world):
    camera = replace(world.intrinsics, fx=1.2 * world.intrinsics.fx, fy=1.2 * world.intrinsics.fy)
    moved = (
        bodies_of(world, camera, noise=1).parameters.transl
        - bodies_of(world, noise=1).parameters.transl
    )
    assert moved[0, :2] == pytest.approx([0, 0], abs=1e-5)
    assert 0.15 < moved[0, 2] / world.joints[0, 0, 2] < 0.25


def test_children_come_out_as_adults_who_are_farther_away():
    world = load_world("child_by_the_hand_view1")
    model = load_body(world.body_model)
    adult = np.isnan(world.ages).argmax()
    child = np.isfinite(world.ages).argmax()
    ratios = []
    for seed in range(40):
        parameters = bodies_of(world, noise=1, noise_seed=seed).parameters
        stature = model.stature(torch.tensor(parameters.betas)) / model.stature(
            torch.tensor(world.parameters.betas)
        )
        depth = 1 + (parameters.transl - world.parameters.transl)[:, 2] / world.joints[:, 0, 2]
        ratios.append(np.stack([stature.numpy(), depth])[:, [adult, child]])
    (adult_taller, child_taller), (adult_farther, child_farther) = np.log(ratios).mean(0)
    zero = float(
        model.stature(torch.zeros(1, 16))
        / model.stature(torch.tensor(world.parameters.betas))[child]
    )
    assert child_taller == pytest.approx(np.log(zero) - 0.06, abs=0.03)
    assert child_farther == pytest.approx(np.log(zero) - 0.06, abs=0.03)
    assert adult_taller == pytest.approx(-0.06, abs=0.03)
    assert adult_farther == pytest.approx(-0.06, abs=0.03)


@pytest.mark.slow
def test_bodies_have_the_stated_distance_and_stature(world):
    nearer = []
    taller = []
    growth = log_stature_gradient(world.body_model)
    for seed in range(200):
        bodies = bodies_of(world, noise=1, noise_seed=seed)
        depth = (
            world.joints[0, 0, 2] + bodies.parameters.transl[0, 2] - world.parameters.transl[0, 2]
        )
        nearer.append(np.log(depth / world.joints[0, 0, 2]))
        taller.append(growth @ (bodies.parameters.betas[0] - world.parameters.betas[0]))
    assert np.mean(nearer) == pytest.approx(-0.06, abs=0.015)
    assert np.std(nearer) == pytest.approx(np.hypot(0.045, 0.05), rel=0.15)
    assert np.mean(taller) == pytest.approx(-0.06, abs=0.012)
    assert np.std(taller) == pytest.approx(0.045, rel=0.15)
    assert np.corrcoef(nearer, taller)[0, 1] == pytest.approx(
        0.045 / np.hypot(0.045, 0.05), abs=0.1
    )
