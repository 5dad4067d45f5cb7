"""People of whom only the upper part is visible, and joints that other people cover."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from physic_embedded.networks.crops import RotatedSquare
from physic_embedded.networks.pose import Pose
from physic_embedded.segmentation.hidden_people import without_covered
from physic_embedded.segmenter import EmbeddedSegmenter, EmbeddedSegmenterOptions

NOSE, SHOULDERS, HIPS = 0, [11, 12], [23, 24]


@pytest.fixture(scope="module")
def find():
    """Joints (N, 33, 2) px of the people in an image, from left to right."""
    backend = EmbeddedSegmenter(EmbeddedSegmenterOptions(threads=1, tile_fractions=()))
    backend.load()

    def joints(image):
        points = backend.infer(image).keypoints.points
        return points[np.argsort(points[:, NOSE, 0])]

    yield joints
    backend.close()


@pytest.fixture(scope="module")
def couple(pytestconfig):
    bgr = cv2.imread(str(pytestconfig.rootpath / "examples" / "couple.jpg"))
    return np.ascontiguousarray(bgr[..., ::-1])


def trunk_px(joints):
    return np.linalg.norm(joints[SHOULDERS].mean(0) - joints[HIPS].mean(0))


def test_a_table_before_the_hips_does_not_shorten_the_trunk(find, couple):
    whole = find(couple)
    for person in whole:
        shoulders, hips = person[SHOULDERS].mean(0), person[HIPS].mean(0)
        behind_table = couple.copy()
        behind_table[int(shoulders[1] + 0.8 * (hips[1] - shoulders[1])) :] = (110, 80, 50)
        found = find(behind_table)
        same = found[np.linalg.norm(found[:, NOSE] - person[NOSE], axis=1).argmin()]
        assert trunk_px(same) == pytest.approx(trunk_px(person), rel=0.2)


def test_joints_that_another_person_covers_are_not_visible():
    square = RotatedSquare(np.array([50.0, 40.0]), 40.0, 0.0)
    mask = np.full((256, 256), -1.0)
    mask[:, 128:] = 1.0  # the right half of the square
    joints = np.tile([[45.0, 40.0], [55.0, 40.0], [90.0, 40.0]], (11, 1))
    other = Pose(*(np.zeros((33, n)) for n in (2, 1, 1, 3, 1)), 1.0, mask, square, 0.0, 1.0)
    pose = replace(other, points=joints, visibility=np.ones(33), presence=np.ones(33))
    assert without_covered(pose, [other]).visibility[:3] == pytest.approx([1, 0, 1])
    assert without_covered(pose, []).visibility.all()
