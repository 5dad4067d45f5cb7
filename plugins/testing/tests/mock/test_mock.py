from __future__ import annotations

import numpy as np
import pytest

from physic_core.errors import BackendError
from physic_core.types import Hints, Keypoints, People
from physic_mock import backends
from physic_mock.backends import (
    MockBodyEstimator,
    MockContactPrior,
    MockInpainter,
    MockKeypointDetector,
    MockMetricDepth,
    MockRelativePointmap,
    MockSegmenter,
)
from physic_testing.conformance.backend_under_test import find_backend
from physic_testing.conformance.kit import start_checks
from physic_testing.worlds import labels, load_world

pytestmark = pytest.mark.quick

WORLDS = ("stand", "sit_on_stool", "hug")


@pytest.fixture(scope="module", params=WORLDS)
def world(request):
    return load_world(request.param)


@pytest.fixture(scope="module")
def two():
    return load_world("hug")


def everyone(world):
    return People(
        masks=world.masks.copy(), boxes=world.boxes.copy(), scores=np.ones(len(world.masks))
    )


def known(depth):
    """NaN in the sky, as the mocks answer it."""
    return np.where(np.isfinite(depth), depth, np.nan)


def no_keypoints(count):
    return Keypoints(np.zeros((count, 17, 2)), np.zeros((count, 17)), "coco17")


def pose(world, **options):
    estimator = MockBodyEstimator(**options)
    count = len(world.masks)
    return estimator.infer(
        world.image, everyone(world), world.intrinsics, no_keypoints(count), Hints()
    )


@pytest.mark.parametrize("name", backends.__all__)
def test_the_answers_are_the_truth(name):
    unknown = {"unknown": "scale"} if name == "MockRelativePointmap" else {}
    kind = getattr(backends, name)
    subject = find_backend(kind, None, options=unknown, capabilities={"exact"}, size=(160, 120))
    result = start_checks(subject).result("is_exact")
    assert result.outcome == "passed", result


def test_a_drawn_shift_leaves_out_only_what_is_farthest(world):
    for noise_seed in range(4):
        network = MockRelativePointmap(noise=1, noise_seed=noise_seed)
        answer = network.infer(world.image, Hints())
        assert (answer.points[answer.valid, 2] > 0).all()
        assert (np.isfinite(world.depth) & ~answer.valid).mean() < 0.06


def test_metric_depth_has_the_stated_scale_and_sigma(world):
    depth = MockMetricDepth(scale=1.25, stated_sigma=0.2).infer(world.image, Hints())
    np.testing.assert_allclose(depth.depth, 1.25 * known(world.depth), rtol=1e-6)
    assert depth.scale_sigma == 0.2
    assert depth.notes == ("mock: true depth times 1.25",)


def test_one_of_two_people_can_be_taken_out(two):
    image = MockInpainter().infer(two.image, two.masks[0])
    people = MockSegmenter().infer(image)
    assert len(people) == 1
    np.testing.assert_array_equal(people.masks[0], two.masks[1])
    depth = MockMetricDepth().infer(image, Hints()).depth
    np.testing.assert_allclose(depth[two.masks[1]], two.depth[two.masks[1]], rtol=1e-6)


def test_a_hole_filled_by_another_inpainter_is_recognised_with_the_hint(two):
    hole = two.masks.any(axis=0)
    image = two.image.copy()
    image[hole] = 128
    model = MockMetricDepth()
    with pytest.raises(BackendError):
        model.infer(image, Hints())
    np.testing.assert_allclose(
        model.infer(image, Hints(hole=hole)).depth, known(two.empty_depth), rtol=1e-6
    )


def refusal(image):
    with pytest.raises(BackendError) as caught:
        MockSegmenter().infer(image)
    return str(caught.value)


def test_another_photo_is_refused(two):
    assert "80 x 60 px image carries no world's label" in refusal(np.zeros((60, 80, 3), np.uint8))
    other = labels.embed_label(two.image, "moon")
    assert "image is of the world 'moon', which does not exist" in refusal(other)
    painted = two.image.copy()
    painted[100:112, 100:200] ^= 0x40
    assert "differs from the world 'hug' in 1.6% of its pixels" in refusal(painted)
    # And it does not try to draw one that large.
    large = labels.embed_label(np.zeros((1500, 1900, 3), np.uint8), "hug")
    assert "1900 x 1500 px image is larger than mocks accept (2764800 px in all)" in refusal(large)


def test_rounding_of_another_machine_is_forgiven(two):
    image = two.image.copy()
    image[::3] = np.clip(image[::3].astype(int) + 1, 0, 255)
    assert len(MockSegmenter().infer(labels.embed_label(image, "hug"))) == 2


def test_a_person_who_is_not_in_the_world_is_refused(two):
    mask = np.zeros((1, *two.image.shape[:2]), bool)
    mask[0, :20, :20] = True
    with pytest.raises(BackendError, match=r"^Person 0 is nobody of the mock world 'hug'"):
        MockKeypointDetector().infer(
            two.image, People(mask, np.array([[0.0, 0, 20, 20]]), np.ones(1))
        )


def test_contact_for_another_body_brings_the_worlds_mesh(two):
    from dataclasses import replace

    embedded = MockContactPrior().infer(two.image, everyone(two), pose(two))
    contact = MockContactPrior().infer(
        two.image, everyone(two), replace(pose(two), body_model="smplx")
    )
    assert embedded.rest is None
    np.testing.assert_array_equal(contact.probability, embedded.probability)
    assert contact.rest.topology == contact.topology == two.topology
    assert contact.rest.vertices.shape == two.vertices[0].shape


def test_a_held_ball_is_in_the_photo_and_is_removed_with_its_mask():
    world = load_world("hold_ball")
    ball = world.item_masks[0]
    exact = MockRelativePointmap(unknown="scale")
    inpainter = MockInpainter()
    for hole, depth in (
        (world.masks.any(0), world.depth),
        (world.masks.any(0) | ball, world.empty_depth),
    ):
        hints = Hints(hole=hole)
        depth_behind = exact.infer(inpainter.infer(world.image, hole), hints).points[..., 2]
        assert np.allclose(depth_behind[ball], depth[ball], rtol=1e-4)
