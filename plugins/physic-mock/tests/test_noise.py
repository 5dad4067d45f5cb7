"""The errors of the mocks are as large as they say, of the kind that they say, and grow with the one common factor."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.body import JOINT_INDEX
from physic_core.types import Hints, Keypoints, People
from physic_mock import NOISE_VERSION
from physic_mock.backends import MockBodyEstimator, MockContactPrior, MockMetricDepth, MockRelativePointmap
from physic_mock.body_noise import BONES, LIMBS, draw_bone_errors
from physic_mock.contact import ContactOptions
from physic_mock.depths import MetricDepthOptions, RelativePointmapOptions
from physic_mock.humans import BodyOptions
from physic_mock.mask_noise import draw_floor_mask
from physic_testing.worlds import build_world

DRAWS = range(300)
SMALL = (160, 120)


@pytest.fixture(scope="module")
def world():
    return build_world("stand", size=SMALL)


@pytest.fixture(scope="module")
def people(world):
    return People(masks=world.masks.copy(), boxes=world.boxes.copy(), scores=np.ones(len(world.masks)))


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def bodies_of(world, people, **options):
    keypoints = Keypoints(np.zeros((len(people), 17, 2)), np.zeros((len(people), 17)), "coco17")
    estimator = MockBodyEstimator(BodyOptions(**options))
    return estimator.infer(world.image, people, world.intrinsics, keypoints, Hints())


def test_every_depth_notes_the_noise_version(world):
    notes = MockMetricDepth(MetricDepthOptions(noise=0.5)).infer(world.image, Hints()).notes
    assert notes == (f"mock: true depth with errors of noise model {NOISE_VERSION} times 0.5",)
    notes = MockRelativePointmap().infer(world.image, Hints()).notes
    assert notes == (f"mock: true points in an unknown unit with errors of noise model {NOISE_VERSION} times 1",)


def lean(hidden: np.ndarray, seed: int) -> np.ndarray:
    return draw_bone_errors(np.eye(3), hidden, 8.0, 3.0, 0.5, 2.0, 0.5, rng(seed))


def test_bones_err_in_depth_more_than_in_the_picture_and_more_where_hidden():
    nobody = np.zeros(BONES, bool)
    errors = np.degrees([lean(nobody, seed) for seed in range(1000)])
    knee, spine = JOINT_INDEX["left_knee"], JOINT_INDEX["spine2"]
    np.testing.assert_allclose(errors[:, knee].std(axis=0), [8, 8, 3], rtol=0.1)
    np.testing.assert_allclose(errors[:, spine].std(axis=0), [4, 4, 1.5], rtol=0.1)
    assert (errors[:, 0] == 0).all()
    hidden = nobody.copy()
    hidden[knee] = True
    np.testing.assert_allclose(np.degrees(lean(hidden, 7))[knee], 2 * errors[7, knee])


def test_bones_of_a_limb_share_half_of_their_error():
    errors = np.array([lean(np.zeros(BONES, bool), seed) for seed in range(1000)])[..., 0]
    one, same, other = (JOINT_INDEX[name] for name in ("left_hip", "left_ankle", "right_hip"))
    assert LIMBS[one] == LIMBS[same] == "left leg"
    assert np.corrcoef(errors[:, one], errors[:, same])[0, 1] == pytest.approx(0.5, abs=0.1)
    assert np.corrcoef(errors[:, one], errors[:, other])[0, 1] == pytest.approx(0, abs=0.1)


def test_people_stray_along_their_line_of_sight(world, people):
    true = world.joints[0, 0].astype(float)
    moved = np.array(
        [bodies_of(world, people, noise_seed=s, shape_noise=0, stature_noise=0).parameters.transl[0] for s in range(60)]
    )
    error = moved - world.parameters.transl[0] + true
    along = np.log(error @ true / (true @ true))
    across = error - np.exp(along)[:, None] * true
    options = BodyOptions()
    assert along.std() == pytest.approx(options.depth_noise, rel=0.25)
    assert np.sqrt((across**2).sum(axis=1).mean() / 2) == pytest.approx(options.lateral_noise_m, rel=0.25)


def test_contact_has_its_precision_and_recall_on_average_and_patches(world, people):
    contact, bodies = world.contact[0], bodies_of(world, people, noise=0)
    hits = false = 0
    recalls = []
    for seed in DRAWS:
        answer = MockContactPrior(ContactOptions(noise_seed=seed)).infer(world.image, people, bodies)
        found = answer.probability[0] > 0.5
        assert not found[~world.outer].any()
        hits, false = hits + (found & contact).sum(), false + (found & ~contact).sum()
        recalls.append((found & contact).sum() / contact.sum())
    assert hits / (hits + false) == pytest.approx(0.41, abs=0.03)
    assert np.mean(recalls) == pytest.approx(0.35, abs=0.03)
    assert np.std(recalls) == pytest.approx(0.4 * np.sqrt(0.35 * 0.65), rel=0.15)
    # In patches: whoever is found has mostly neighbours that are.
    own = found[world.faces].sum(axis=1)
    assert (own == 3).sum() > 2 * ((own == 1) | (own == 2)).sum()


def test_false_contact_lies_mostly_on_parts_that_often_touch(world, people):
    from physic_core.body import load_body

    often = np.concatenate([v.numpy() for v in load_body("embedded").contact_sets.values()])
    bodies = bodies_of(world, people, noise=0)
    shares = []
    for lure in (0.0, 3.0):
        options = ContactOptions(lure=lure, spread=0)
        found = MockContactPrior(options).infer(world.image, people, bodies).probability[0] > 0.5
        false = np.flatnonzero(found & ~world.contact[0])
        shares.append(np.isin(false, often).mean())
    assert shares[1] > shares[0]


def test_metric_depth_has_one_scale_error_for_all_pixels_and_states_its_sigma(world):
    options = MetricDepthOptions(scale_sigma=0.1, focal_sigma=0.05, warp=0, smear_px=0)
    answers = [MockMetricDepth(replace_seed(options, s)).infer(world.image, Hints()) for s in range(100)]
    ratios = np.array([a.depth / world.depth for a in answers])
    assert (ratios.std(axis=(1, 2)) < 1e-5).all()
    focal = np.array([a.intrinsics.fx / world.intrinsics.fx for a in answers])
    assert np.log(focal).std() == pytest.approx(0.05, rel=0.25)
    # A focal length that is too long takes things too far.
    assert np.log(ratios.mean(axis=(1, 2)) / focal).std() == pytest.approx(0.1, rel=0.25)
    assert [a.scale_sigma for a in answers] == pytest.approx([np.hypot(0.1, 0.05)] * len(answers))


def replace_seed(options, seed):
    return options.model_copy(update={"noise_seed": seed})


def test_the_two_pictures_share_warp_and_bumps_and_differ_by_their_disagreement(world):
    background = ~world.masks.any(axis=0)
    quiet = {"unknown": "scale", "scale_sigma": 0, "photo_scale_sigma": 0, "smear_px": 0}
    for disagreement in (0.0, 0.02):
        spread = []
        for seed in range(12):
            options = RelativePointmapOptions(noise_seed=seed, disagreement=disagreement, **quiet)
            model = MockRelativePointmap(options)
            photo, empty = (model.infer(i, Hints()).points[..., 2] for i in (world.image, world.empty_image))
            spread.append(np.log(photo[background] / empty[background]))
        assert np.std(spread) == pytest.approx(np.sqrt(2) * disagreement, rel=0.3, abs=1e-6)


def test_errors_of_the_floor_mask_add_and_remove_patches(world):
    floor = world.empty_floor_mask
    rough = draw_floor_mask(floor, 0, 8, 1, rng())
    assert (rough & ~floor).any()
    assert (floor & ~rough).any()
    assert (rough & floor).sum() / (rough | floor).sum() > 0.8
    np.testing.assert_array_equal(draw_floor_mask(floor, 0, 8, 0, rng()), floor)
    nothing = np.zeros_like(floor)
    np.testing.assert_array_equal(draw_floor_mask(nothing, 0, 8, 1, rng()), nothing)
