from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_core.interfaces import KeypointDetector
from physic_core.types import People
from physic_embedded.keypoint_detector import EmbeddedKeypoints, EmbeddedKeypointsOptions
from physic_testing import violations


@pytest.fixture(scope="module")
def detector():
    backend = EmbeddedKeypoints(EmbeddedKeypointsOptions(threads=1))
    backend.load()
    return backend


def test_joints_of_the_embedded_segmenter_are_taken_as_they_are(people, image):
    assert EmbeddedKeypoints().infer(image, people) is people.keypoints


def test_people_of_another_segmenter_get_the_same_joints(detector, people, image):
    found = detector.infer(image, replace(people, keypoints=None))
    assert violations(KeypointDetector, found, people=2) == []
    clear = people.keypoints.confidence > 0.5
    apart = np.linalg.norm(found.points - people.keypoints.points, axis=-1)
    tall = people.boxes[:, 3] - people.boxes[:, 1]
    error = apart.mean(axis=1, where=clear) / tall
    assert (error < 0.025).all()


def test_a_mask_without_a_person_gets_no_confidence(detector):
    mask = np.zeros((1, 240, 320), bool)
    mask[:, 40:200, 100:180] = True
    grey = np.full((240, 320, 3), 128, np.uint8)
    found = detector.infer(grey, People(mask, np.array([[100, 40, 180, 200.0]]), np.ones(1)))
    assert violations(KeypointDetector, found, people=1) == []
    assert found.confidence.max() == 0


def test_limbs_beyond_the_edge_of_the_photo_have_no_confidence(people):
    knees_and_below = people.keypoints.confidence[:, 25:33]
    assert knees_and_below[0].mean() > 0.6
    assert knees_and_below[1].max() < 0.2
