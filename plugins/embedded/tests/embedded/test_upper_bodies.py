"""People of whom only the upper part is visible, and joints that other people cover."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

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
