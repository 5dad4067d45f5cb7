"""The embedded observer of people: regions, sides, and whose pass of the encoder it reads."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.interfaces import PersonObserver
from physic_core.interfaces.people import PersonObserverRequest
from physic_core.types import Hints, Intrinsics, Keypoints, People, skeleton_named
from physic_core.types.observations import PROBABILITIES
from physic_embedded.networks.patch_tokens import PatchTokens
from physic_embedded.person_observer import (
    EmbeddedPersonObserver,
    features_of_questions,
    fitted_numbers,
    observations_from_features,
)
from physic_networks.pictures import Letterbox

NAMES = skeleton_named("blazepose33").names
PHOTO = np.random.default_rng(1).integers(0, 255, (84, 112, 3), np.uint8)
CAMERA = Intrinsics.from_focal(100.0, 112, 84)


@pytest.fixture
def grid():
    """Patches of 10 px of a photo of 120 x 80 px, numbered by row and column."""
    numbers = np.stack(np.meshgrid(np.arange(8.0), np.arange(12.0), indexing="ij"), axis=-1)
    return PatchTokens(numbers, 10, Letterbox(1.0, 0, 0, (80, 120), (80, 120)))


def keypoints_at(places, confidence=1.0):
    """Keypoints of one person: those named lie there, the others are not seen."""
    points = np.zeros((1, len(NAMES), 2), np.float32)
    score = np.zeros((1, len(NAMES)), np.float32)
    for name, place in places.items():
        points[0, NAMES.index(name)] = place
        score[0, NAMES.index(name)] = confidence
    return Keypoints(points, score, "blazepose33")


def foot(side, place):
    return {f"{side}_{name}": place for name in ("ankle", "heel", "foot_tip")}


BOX = np.array([[0, 0, 120, 80]])


def test_a_limb_is_read_where_its_keypoints_are(grid):
    found = features_of_questions(grid, BOX, keypoints_at(foot("right", (65, 45))))
    np.testing.assert_allclose(found["foot"][0, 1], (4, 6))
    np.testing.assert_allclose(found["posture"][0, 0, :2], (3.5, 5.5))
    assert np.isnan(found["foot"][0, 0]).all()
    assert np.isnan(found["seat"]).all()


def test_a_hand_is_read_where_its_fingers_are_too(grid):
    hand = dict.fromkeys(("left_wrist", "left_pinky1", "left_index1"), (45, 45))
    found = features_of_questions(grid, BOX, keypoints_at({"left_elbow": (20, 45)} | hand))["hand"]
    np.testing.assert_allclose(found[0, 0, :4], (4, 4, 4, 5))


@pytest.mark.parametrize(
    ("place", "confidence", "read"),
    [((65, 45), 0.05, True), ((65, 45), 0.0, False), ((65, 81), 1.0, False)],
)
def test_a_limb_is_read_in_the_picture_of_a_person_that_the_detector_found(
    grid, place, confidence, read
):
    found = features_of_questions(grid, BOX, keypoints_at(foot("left", place), confidence))["foot"]
    assert np.isfinite(found[0, 0]).all() == read


def test_a_detector_without_hands_says_nothing_of_hands(grid):
    coco = Keypoints(np.full((1, 17, 2), 40, np.float32), np.ones((1, 17), np.float32), "coco17")
    found = features_of_questions(grid, BOX, coco)
    assert np.isfinite(found["foot"]).all()
    assert np.isfinite(found["seat"]).all()


def test_sides_and_people_change_places_with_their_keypoints():
    channels = fitted_numbers()["foot"].shape[1] - 2
    tokens = PatchTokens(
        np.random.default_rng(2).normal(size=(8, 12, channels)),
        10,
        Letterbox(1.0, 0, 0, (80, 120), (80, 120)),
    )
    one = keypoints_at(foot("left", (15, 70)) | foot("right", (75, 70)))
    other = keypoints_at(foot("left", (75, 70)) | foot("right", (15, 70)))
    box = np.array([[0, 0, 90, 80]])
    first, second = (
        observations_from_features(features_of_questions(tokens, box, k), fitted_numbers())
        for k in (one, other)
    )
    np.testing.assert_array_equal(first.touch[0, :2], second.touch[0, 1::-1])
    assert np.isnan(first.touch[0, 2:]).all()


@pytest.fixture
def two_people():
    """Two people side by side, all of whose keypoints are seen."""
    masks = np.zeros((2, *PHOTO.shape[:2]), bool)
    masks[0, 10:70, 10:40] = masks[1, 10:70, 60:90] = True
    boxes = np.array([[10, 10, 40, 70], [60, 10, 90, 70]], np.float32)
    rng = np.random.default_rng(3)
    points = rng.uniform(boxes[:, None, :2], boxes[:, None, 2:], (2, len(NAMES), 2))
    keypoints = Keypoints(
        points.astype(np.float32), np.ones((2, len(NAMES)), np.float32), "blazepose33"
    )
    return People(masks, boxes, np.ones(2, np.float32)), keypoints


def test_the_observer_says_the_same_with_its_own_pass(two_people):
    from physic_embedded.relative_pointmap import EmbeddedPointmap

    people, keypoints = two_people
    observer = EmbeddedPersonObserver()
    observer.load()
    alone = observer.infer(PHOTO, people, keypoints, CAMERA)
    request = PersonObserverRequest(PHOTO, people, keypoints, CAMERA)
    assert not list(PersonObserver.check(alone, request))
    assert all(np.isfinite(getattr(alone, name)).all() for name in PROBABILITIES)

    observer.close()
    observer.load()
    pointmap = EmbeddedPointmap(EmbeddedPointmap.Options(focal_from_edges=False))
    pointmap.load()
    scene = pointmap.infer(PHOTO, Hints())
    pointmap.infer(PHOTO, Hints(scene=scene, people=people))
    again = observer.infer(PHOTO, people, keypoints, CAMERA)
    assert set(observer.network) == {"face_landmark"}  # the encoder was not opened again
    for name in PROBABILITIES:
        np.testing.assert_array_equal(getattr(again, name), getattr(alone, name))
