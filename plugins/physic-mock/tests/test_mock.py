from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_core.body import load_body
from physic_core.body.parameters import rotations_from_parameters
from physic_core.errors import BackendError
from physic_core.types import Hints, Keypoints, People
from physic_mock import NOISE_VERSION
from physic_mock.backends import (
    MockBodyEstimator,
    MockContactPrior,
    MockHandEstimator,
    MockInpainter,
    MockKeypointDetector,
    MockMetricDepth,
    MockRelativePointmap,
    MockSegmenter,
)
from physic_mock.contact import ContactOptions
from physic_mock.depths import MetricDepthOptions, RelativePointmapOptions
from physic_mock.humans import BodyOptions, HandOptions
from physic_mock.keypoints import KeypointOptions
from physic_mock.pixels import InpainterOptions, SegmenterOptions
from physic_testing.worlds import build_world, labels

WORLDS = ("stand", "sit_on_stool", "hug")
TRUE_DEPTH = MetricDepthOptions(noise=0)
TRUE_MASKS = SegmenterOptions(noise=0)


@pytest.fixture(scope="module", params=WORLDS)
def world(request):
    return build_world(request.param)


@pytest.fixture(scope="module")
def two():
    return build_world("hug")


def everyone(world) -> People:
    return People(masks=world.masks.copy(), boxes=world.boxes.copy(), scores=np.ones(len(world.masks)))


def known(depth: np.ndarray) -> np.ndarray:
    """NaN in the sky, as the mocks answer it."""
    return np.where(np.isfinite(depth), depth, np.nan)


def no_keypoints(count: int) -> Keypoints:
    return Keypoints(np.zeros((count, 17, 2)), np.zeros((count, 17)), "coco17")


def pose(world, **options):
    estimator = MockBodyEstimator(BodyOptions(**options))
    count = len(world.masks)
    return estimator.infer(world.image, everyone(world), world.intrinsics, no_keypoints(count), Hints())


def posed(bodies):
    model = load_body("embedded")
    parameters = bodies.parameters
    rotations = rotations_from_parameters(parameters, "cpu", torch.float32)
    return model(rotations, torch.tensor(parameters.betas), torch.tensor(parameters.transl))


def error_after_procrustes(a: np.ndarray, b: np.ndarray) -> float:
    a, b = a - a.mean(0), b - b.mean(0)
    u, s, vt = np.linalg.svd(a.T @ b)
    flip = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    aligned = (s * flip).sum() / (a**2).sum() * a @ (u * flip) @ vt
    return float(np.linalg.norm(aligned - b, axis=1).mean())


def test_without_noise_the_answers_are_the_truth(world):
    people = MockSegmenter(TRUE_MASKS).infer(world.image)
    np.testing.assert_array_equal(people.masks, world.masks)
    np.testing.assert_array_equal(people.boxes, world.boxes)
    np.testing.assert_array_equal(people.floor, world.floor_mask)
    exact = MockKeypointDetector(KeypointOptions(skeleton="coco17", noise=0)).infer(world.image, people)
    np.testing.assert_array_equal(exact.points, world.keypoints["coco17"])
    assert ((exact.confidence > 0.5) == world.visible["coco17"]).all()
    depth = MockMetricDepth(TRUE_DEPTH).infer(world.image, Hints())
    np.testing.assert_array_equal(depth.depth, known(world.depth))
    assert depth.intrinsics.matrix.tolist() == world.intrinsics.matrix.tolist()
    for image, people_in in ((world.image, True), (world.empty_image, False)):
        answer = MockRelativePointmap(RelativePointmapOptions(noise=0)).infer(image, Hints())
        points = known(world.points(people=people_in))
        np.testing.assert_allclose(answer.points[answer.valid], points[answer.valid], rtol=1e-6)
        np.testing.assert_array_equal(answer.valid, np.isfinite(points[..., 2]))
    bodies = pose(world, noise=0)
    for name in ("global_orient", "body_pose", "betas", "transl"):
        np.testing.assert_allclose(getattr(bodies.parameters, name), getattr(world.parameters, name), atol=2e-6)
    np.testing.assert_array_equal(bodies.observed, world.joints_visible)
    hands = MockHandEstimator(HandOptions(noise=0)).infer(world.image, people, no_keypoints(len(people)))
    np.testing.assert_allclose(hands.rotvecs[:, 1].reshape(-1, 45), world.parameters.right_hand_pose, atol=1e-6)
    np.testing.assert_array_equal(hands.confidence > 0, world.joints_visible[:, [20, 21]])
    perfect = MockContactPrior(ContactOptions(noise=0)).infer(world.image, people, bodies)
    np.testing.assert_array_equal(perfect.probability > 0.5, world.contact)


@pytest.mark.parametrize("unknown", ["scale", "scale_shift", "inverse_scale_shift"])
def test_the_point_map_is_metric_once_its_unknowns_are_undone(world, unknown):
    scale, shift = 1.7, -0.03
    options = RelativePointmapOptions(noise=0, unknown=unknown, scale=scale, shift=shift)
    answer = MockRelativePointmap(options).infer(world.image, Hints())
    assert answer.unknown == unknown
    seen = np.isfinite(world.depth)
    np.testing.assert_array_equal(answer.valid, seen)
    z = answer.points[..., 2].astype(float)
    metric = {"scale": scale * z, "scale_shift": scale * z + shift, "inverse_scale_shift": 1 / (scale / z + shift)}[
        unknown
    ]
    np.testing.assert_allclose(metric, known(world.depth), rtol=1e-5)
    # x and y: on the pixel's ray, of the metric depth with an additive shift, of its own depth otherwise.
    sideways = (
        scale * answer.points[..., :2]
        if unknown != "inverse_scale_shift"
        else answer.points[..., :2] * (metric / z)[..., None]
    )
    np.testing.assert_allclose(sideways[seen], world.points(people=True)[seen, :2], atol=1e-4)


@pytest.mark.parametrize("unknown", ["scale_shift", "inverse_scale_shift"])
def test_a_drawn_shift_keeps_everything_in_front_of_the_camera(world, unknown):
    for noise_seed in range(4):
        options = RelativePointmapOptions(unknown=unknown, shift_sigma=0.9, noise_seed=noise_seed)
        answer = MockRelativePointmap(options).infer(world.image, Hints())
        np.testing.assert_array_equal(answer.valid, np.isfinite(world.depth))
        assert (answer.points[answer.valid, 2] > 0).all()


def test_metric_depth_is_wrong_by_its_scale_and_a_warp(world):
    options = MetricDepthOptions(scale=1.25, scale_sigma=0, focal_sigma=0, smear_px=0, warp=0.03, stated_sigma=0.2)
    depth = MockMetricDepth(options).infer(world.image, Hints())
    ratio = (depth.depth / world.depth)[np.isfinite(world.depth)]
    assert abs(np.log(ratio).mean() - np.log(1.25)) < 0.05
    assert 0.005 < np.log(ratio).std() < 0.06
    assert depth.scale_sigma == 0.2
    assert depth.notes == (f"mock: true depth times 1.25 with errors of noise model {NOISE_VERSION} times 1",)


def test_metric_depth_without_noise_states_a_small_scale_sigma_that_is_valid(world):
    found = MockMetricDepth(MetricDepthOptions(noise=0)).infer(world.empty_image, Hints())
    assert found.scale_sigma == 1e-3


def test_ragged_masks_stay_near_the_truth(world):
    options = SegmenterOptions(raggedness_px=1.5, missed_ends=0, strays=0)
    for mask, truth in zip(MockSegmenter(options).infer(world.image).masks, world.masks, strict=True):
        overlap = (mask & truth).sum() / (mask | truth).sum()
        assert 0.7 < overlap < 0.995
    assert MockSegmenter(SegmenterOptions(floor=False)).infer(world.image).floor is None


def test_keypoints_stray_by_their_noise_and_more_where_hidden():
    errors = {True: [], False: []}
    for name in WORLDS:
        world = build_world(name)
        size = (world.boxes[:, 2:] - world.boxes[:, :2]).max(axis=1)
        for noise_seed in range(4):
            options = KeypointOptions(
                noise_seed=noise_seed, point_noise=0.006, hidden_noise=0.02, overconfident=0, swapped=0
            )
            answer = MockKeypointDetector(options).infer(world.image, everyone(world))
            error = np.linalg.norm(answer.points - world.keypoints["blazepose33"], axis=2) / size[:, None]
            visible = world.visible["blazepose33"]
            for seen in errors:
                errors[seen].append(error[visible == seen])
            assert (answer.confidence[visible] > 0.8).all()
            assert (np.abs(answer.confidence[~visible] / 0.3 - 1) <= 0.5).all()
    rms = {seen: np.sqrt((np.concatenate(e) ** 2).mean() / 2) for seen, e in errors.items()}
    assert rms[True] == pytest.approx(0.006, rel=0.1)
    assert rms[False] == pytest.approx(0.02, rel=0.2)


def test_bodies_start_about_where_the_paper_starts():
    aligned, absolute = [], []
    for name in WORLDS:
        world = build_world(name)
        for noise_seed in range(6):
            output = posed(pose(world, noise_seed=noise_seed))
            for a, b in zip(output.joints[:, :22].numpy(), world.joints[:, :22], strict=True):
                aligned.append(1000 * error_after_procrustes(a, b))
                absolute.append(1000 * np.linalg.norm(a - b, axis=1).mean())
    assert 36 < np.mean(aligned) < 48
    assert 300 < np.mean(absolute) < 1100


def test_a_picture_without_people_has_the_depth_behind_them(two):
    people = MockSegmenter().infer(two.empty_image)
    assert len(people) == 0
    assert people.masks.shape == (0, *two.image.shape[:2])
    assert people.boxes.shape == (0, 4)
    floor = MockSegmenter(TRUE_MASKS).infer(two.empty_image).floor
    np.testing.assert_array_equal(floor, two.empty_floor_mask)
    depth = MockMetricDepth(TRUE_DEPTH).infer(two.empty_image, Hints())
    np.testing.assert_allclose(depth.depth, known(two.empty_depth), rtol=1e-6)


def test_one_of_two_people_can_be_taken_out(two):
    image = MockInpainter().infer(two.image, two.masks[0])
    people = MockSegmenter(TRUE_MASKS).infer(image)
    assert len(people) == 1
    np.testing.assert_array_equal(people.masks[0], two.masks[1])
    depth = MockMetricDepth(TRUE_DEPTH).infer(image, Hints()).depth
    np.testing.assert_allclose(depth[two.masks[1]], two.depth[two.masks[1]], rtol=1e-6)


def test_a_hole_filled_by_another_inpainter_is_recognised_with_the_hint(two):
    hole = two.masks.any(axis=0)
    image = two.image.copy()
    image[hole] = 128
    model = MockMetricDepth(TRUE_DEPTH)
    with pytest.raises(BackendError):
        model.infer(image, Hints())
    np.testing.assert_allclose(model.infer(image, Hints(hole=hole)).depth, known(two.empty_depth), rtol=1e-6)


def refusal(image: np.ndarray) -> str:
    with pytest.raises(BackendError) as caught:
        MockSegmenter().infer(image)
    return str(caught.value)


def test_another_photo_is_refused(two):
    only = "The mock backends only know the photos of their own worlds, and this "
    give = (
        ": give physic_testing.worlds.build_world(name, seed, size).image, saved without loss, or choose real backends."
    )
    blank = np.zeros((60, 80, 3), np.uint8)
    assert refusal(blank) == f"{only}80 x 60 px image carries no world's label{give}"
    other = labels.embed_label(two.image, "moon", 3)
    assert "image is of the world 'moon', which there is not" in refusal(other)
    painted = two.image.copy()
    painted[100:112, 100:200] ^= 0x40
    assert "differs from the world 'hug', seed 0, in 1.6% of its pixels" in refusal(painted)
    # And it does not try to draw one that large.
    large = labels.embed_label(np.zeros((1500, 1900, 3), np.uint8), "hug", 0)
    assert "1900 x 1500 px image is larger than worlds are drawn (2764800 px in all)" in refusal(large)


def test_any_world_is_recognised_by_its_label():
    world = build_world("stand", seed=5, size=(160, 120))
    assert len(MockSegmenter().infer(world.image)) == 1
    assert len(MockSegmenter().infer(world.empty_image)) == 0


def test_rounding_of_another_machine_is_forgiven(two):
    image = two.image.copy()
    image[::3] = np.clip(image[::3].astype(int) + 1, 0, 255)
    assert len(MockSegmenter().infer(labels.embed_label(image, "hug", 0))) == 2


def test_a_person_who_is_not_in_the_world_is_refused(two):
    mask = np.zeros((1, *two.image.shape[:2]), bool)
    mask[0, :20, :20] = True
    with pytest.raises(BackendError, match=r"^Person 0 is nobody of the mock world 'hug'"):
        MockKeypointDetector().infer(two.image, People(mask, np.array([[0.0, 0, 20, 20]]), np.ones(1)))


def test_contact_for_another_body_brings_the_worlds_mesh(two):
    from dataclasses import replace

    embedded = MockContactPrior().infer(two.image, everyone(two), pose(two))
    found = MockContactPrior().infer(two.image, everyone(two), replace(pose(two), body_model="smplx"))
    assert embedded.rest is None
    np.testing.assert_array_equal(found.probability, embedded.probability)
    assert found.rest.topology == found.topology == two.topology
    assert found.rest.vertices.shape == two.vertices[0].shape


def test_a_held_ball_is_in_the_photo_and_is_removed_with_its_mask():
    world = build_world("hold_ball")
    people = MockSegmenter(TRUE_MASKS).infer(world.image)
    assert people.objects is not None
    assert np.array_equal(people.objects, world.item_masks)
    assert MockSegmenter(SegmenterOptions(objects=False)).infer(world.image).objects is None
    ball = world.item_masks[0]
    exact = MockRelativePointmap(RelativePointmapOptions(noise=0, unknown="scale"))
    inpainter = MockInpainter(InpainterOptions(noise=0))
    for hole, depth in ((world.masks.any(0), world.depth), (world.masks.any(0) | ball, world.empty_depth)):
        hints = Hints(hole=hole)
        found = exact.infer(inpainter.infer(world.image, hole), hints).points[..., 2]
        assert np.allclose(found[ball], depth[ball], rtol=1e-4)
