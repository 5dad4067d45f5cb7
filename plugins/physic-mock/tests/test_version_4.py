"""Version 4 of the noise: the drawn errors have the sizes that README.md states, and version 3 is as it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from physic_core.adapters.detections import box_iou
from physic_core.body import load_body
from physic_core.types import Hints, People
from physic_mock.backends import (
    MockBodyEstimator,
    MockContactPrior,
    MockInpainter,
    MockKeypointDetector,
    MockMetricDepth,
    MockRelativePointmap,
    MockSegmenter,
)
from physic_mock.body_noise import depth_flip
from physic_mock.contact import ContactOptions
from physic_mock.fill import fill_from_surroundings
from physic_mock.humans import BodyOptions
from physic_mock.keypoints import KeypointOptions
from physic_testing.conformance.true_keypoints import world_keypoints
from physic_testing.worlds import SKELETONS, build_world

BACKENDS = (
    MockBodyEstimator,
    MockContactPrior,
    MockInpainter,
    MockKeypointDetector,
    MockMetricDepth,
    MockRelativePointmap,
    MockSegmenter,
)


@pytest.fixture(scope="module")
def world():
    return build_world("stand", 0)


def people_of(world):
    return People(world.masks, world.boxes, np.full(len(world.masks), 0.9), None)


def bodies_of(world, camera=None, **options):
    people = people_of(world)
    keypoints = MockKeypointDetector(KeypointOptions(noise=0)).infer(world.image, people)
    estimator = MockBodyEstimator(BodyOptions(**options))
    return estimator.infer(world.image, people, camera or world.intrinsics, keypoints, Hints())


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_version_chooses_defaults_and_given_options_replace_them(backend):
    kind = backend.Options
    assert kind() == kind(version=3)
    assert kind.VERSION_4
    fourth = kind(version=4)
    for name, value in kind.VERSION_4.items():
        assert getattr(fourth, name) == value != getattr(kind(), name)
        assert getattr(kind(version=4, **{name: getattr(kind(), name)}), name) == getattr(kind(), name)
    assert kind.model_validate(fourth.model_dump()) == fourth


def test_without_noise_version_4_is_the_truth(world):
    bodies = bodies_of(world, version=4, noise=0)
    assert np.allclose(bodies.parameters.betas, world.parameters.betas, atol=1e-6)
    assert np.allclose(bodies.parameters.transl, world.parameters.transl, atol=1e-6)
    depth = MockMetricDepth(MockMetricDepth.Options(version=4, noise=0, focal_error=1)).infer(world.image, Hints())
    known = np.isfinite(depth.depth)
    assert np.allclose(depth.depth[known], world.depth[known], rtol=1e-5)


def test_keypoints_have_the_stated_tails(world):
    truth, visible = world_keypoints(world, SKELETONS["blazepose33"])
    size = (world.boxes[:, 2:] - world.boxes[:, :2]).max(1)[:, None]
    error, confidence = [], []
    for seed in range(300):
        options = KeypointOptions(version=4, noise_seed=seed, swapped=0)
        found = MockKeypointDetector(options).infer(world.image, people_of(world))
        error.append(np.linalg.norm(found.points - truth, axis=-1) / size)
        confidence.append(found.confidence)
    error, confidence = np.stack(error), np.stack(confidence)
    shown, hidden = error[:, visible], error[:, ~visible]
    # Of Student's t in the plane: sigma sqrt(n (2^(2/n) - 1)), and with 10 instead of 2 the 90th percentile.
    assert np.median(shown) == pytest.approx(1.51 * 0.016, rel=0.1)
    assert np.quantile(shown, 0.9) == pytest.approx(5.55 * 0.016, rel=0.2)
    assert np.median(hidden) == pytest.approx(1.51 * 0.065, rel=0.15)
    assert (confidence[:, visible] < 0.5).mean() == pytest.approx(0.15, abs=0.02)
    assert (confidence[:, ~visible] > 0.5).mean() == pytest.approx(0.5, abs=0.05)


def test_limbs_are_found_at_people_whose_boxes_overlap():
    world = build_world("group", 0)
    people = people_of(world)
    exact = {"point_noise": 0, "hidden_noise": 0, "swapped": 0}
    truth = MockKeypointDetector(KeypointOptions(**exact)).infer(world.image, people).points
    moved = MockKeypointDetector(KeypointOptions(**exact, neighbour_limbs=1)).infer(world.image, people).points
    wrist = SKELETONS["blazepose33"].names.index("left_wrist")
    nose = SKELETONS["blazepose33"].names.index("nose")
    assert np.array_equal(moved[:, nose], truth[:, nose])
    overlap = box_iou(world.boxes, world.boxes) - np.eye(len(world.boxes))
    assert overlap.max() > 0
    for i, others in enumerate(overlap):
        j = i if others.max() <= 0 else int(others.argmax())
        assert np.array_equal(moved[i, wrist], truth[j, wrist])


def test_bodies_have_the_stated_distance_and_stature(world):
    nearer, taller = [], []
    growth = None
    for seed in range(200):
        found = bodies_of(world, version=4, noise_seed=seed)
        own = world.joints[0, 0, 2] + found.parameters.transl[0, 2] - world.parameters.transl[0, 2]
        nearer.append(np.log(own / world.joints[0, 0, 2]))
        from physic_mock.humans import _log_stature_gradient

        growth = _log_stature_gradient(world.body_model) if growth is None else growth
        taller.append(growth @ (found.parameters.betas[0] - world.parameters.betas[0]))
    assert np.mean(nearer) == pytest.approx(-0.06, abs=0.015)
    assert np.std(nearer) == pytest.approx(np.hypot(0.045, 0.05), rel=0.15)
    assert np.mean(taller) == pytest.approx(-0.06, abs=0.012)
    assert np.std(taller) == pytest.approx(0.045, rel=0.15)
    assert np.corrcoef(nearer, taller)[0, 1] == pytest.approx(0.045 / np.hypot(0.045, 0.05), abs=0.1)


def test_a_wrong_focal_length_moves_bodies_along_the_ray_of_their_pixels(world):
    camera = replace(world.intrinsics, fx=1.2 * world.intrinsics.fx, fy=1.2 * world.intrinsics.fy)
    moved = bodies_of(world, camera, version=4).parameters.transl - bodies_of(world, version=4).parameters.transl
    assert moved[0, :2] == pytest.approx([0, 0], abs=1e-5)
    assert 0.15 < moved[0, 2] / world.joints[0, 0, 2] < 0.25


def test_a_flipped_bone_keeps_its_place_in_the_image():
    sight = np.array([0.0, 0.6, 0.8])
    bone = np.array([0.1, -0.2, 0.25])
    flipped = depth_flip(bone, sight).apply(bone)
    assert flipped @ sight == pytest.approx(-(bone @ sight))
    assert flipped - (flipped @ sight) * sight == pytest.approx(bone - (bone @ sight) * sight)


def test_a_filled_hole_lies_between_its_surroundings_and_a_ramp_goes_on():
    v, u = np.mgrid[:60, :90].astype(np.float64)
    ramp = np.stack([2 * u + v, np.full_like(u, 7.0)], axis=-1)
    hole = (u - 40) ** 2 + (v - 30) ** 2 < 15**2
    filled = fill_from_surroundings(np.where(hole[..., None], -1e6, ramp), hole)
    assert np.array_equal(filled[~hole], ramp[~hole])
    assert np.abs(filled - ramp)[..., 1].max() < 1e-9
    assert np.abs(filled - ramp)[..., 0].max() < 4  # of 75 across the hole
    everywhere = np.ones_like(hole)
    assert np.array_equal(fill_from_surroundings(ramp, everywhere), ramp)


def test_the_hole_is_filled_from_its_surroundings():
    world = build_world("sit_on_sofa", 0)
    hole = world.masks.any(0)
    filled = MockInpainter(MockInpainter.Options(version=4)).infer(world.image, hole)
    assert np.array_equal(filled[~hole], world.image[~hole])
    assert np.abs(filled[hole].astype(int) - world.empty_image[hole]).mean() > 3
    options = {"noise": 1, "warp": 0, "smear_px": 0, "scale_sigma": 0, "focal_sigma": 0}
    hints = Hints(hole=hole)
    seen, made = (
        MockMetricDepth(MockMetricDepth.Options(**options, hole_depth=kind)).infer(filled, hints).depth
        for kind in ("truth", "surroundings")
    )
    assert np.array_equal(seen[~hole], made[~hole])
    assert not np.allclose(seen[hole], made[hole], rtol=0.02)
    assert seen[~hole].min() <= made[hole].min() <= made[hole].max() <= seen[~hole].max()


def test_metric_depth_is_bent_about_the_middle_of_the_floor(world):
    options = {"noise": 1, "warp": 0, "smear_px": 0, "scale_sigma": 0, "focal_sigma": 0, "offset_share": 0.6}
    depth = MockMetricDepth(MockMetricDepth.Options(**options)).infer(world.empty_image, Hints()).depth
    known = np.isfinite(depth) & np.isfinite(world.empty_depth)
    true, floor = world.empty_depth[known].astype(np.float64), world.empty_floor_mask & known
    offset = 0.6 / np.quantile(true, 0.95)
    middle = np.median(world.empty_depth[floor])
    assert 1 / depth[known] == pytest.approx((1 / true - offset) / (1 - offset * middle), rel=1e-3, abs=1e-6)
    assert np.median(depth[floor]) == pytest.approx(middle, rel=1e-3)


def test_the_metric_scale_follows_the_bodies(world):
    people, bodies = people_of(world), bodies_of(world, noise=0)
    farther = replace(bodies.parameters, transl=bodies.parameters.transl + 0.1 * world.joints[:, 0])
    options = MockMetricDepth.Options(version=4, scale_sigma=0, offset_share=0, offset_sigma=0, warp=0)
    one, two = (
        MockMetricDepth(options).infer(
            world.empty_image, Hints(intrinsics=world.intrinsics, people=people, bodies=replace(bodies, parameters=p))
        )
        for p in (bodies.parameters, farther)
    )
    known = np.isfinite(one.depth)
    assert two.depth[known] / one.depth[known] == pytest.approx(1.1, rel=1e-3)
    assert one.intrinsics == world.intrinsics


def test_the_contact_prior_of_fixed_parts_knows_nothing_of_the_truth(world):
    from physic_core.body import load_body

    sets = load_body("embedded").contact_sets
    bodies = bodies_of(world, noise=0)
    bodies = replace(bodies, observed=np.ones_like(bodies.observed))
    prior = MockContactPrior(ContactOptions(version=4)).infer(world.image, people_of(world), bodies)
    assert (prior.probability[:, sets["left_sole"].numpy()] == 1).all()
    assert (prior.probability[:, sets["right_hand"].numpy()] == 0.5).all()
    assert (prior.probability[:, sets["back"].numpy()] == 0).all()  # who stands does not sit
    unseen = replace(bodies, observed=np.zeros_like(bodies.observed))
    assert (
        not MockContactPrior(ContactOptions(version=4)).infer(world.image, people_of(world), unseen).probability.any()
    )


def test_children_come_out_as_adults_who_are_farther_away():
    world = build_world("child_by_the_hand", 1)
    model = load_body(world.body_model)
    adult, child = np.isnan(world.ages).argmax(), np.isfinite(world.ages).argmax()
    ratios = []
    for seed in range(40):
        found = bodies_of(world, version=4, noise_seed=seed).parameters
        stature = model.stature(torch.tensor(found.betas)) / model.stature(torch.tensor(world.parameters.betas))
        depth = 1 + (found.transl - world.parameters.transl)[:, 2] / world.joints[:, 0, 2]
        ratios.append(np.stack([stature.numpy(), depth])[:, [adult, child]])
    (adult_taller, child_taller), (adult_farther, child_farther) = np.log(ratios).mean(0)
    zero = float(model.stature(torch.zeros(1, 16)) / model.stature(torch.tensor(world.parameters.betas))[child])
    assert child_taller == pytest.approx(np.log(zero) - 0.06, abs=0.03)
    assert child_farther == pytest.approx(np.log(zero) - 0.06, abs=0.03)
    assert adult_taller == pytest.approx(-0.06, abs=0.03)
    assert adult_farther == pytest.approx(-0.06, abs=0.03)
