"""People whom the user chose, people who are covered by others, and boxes of people without a
pose.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physic_core.errors import NoPersonError
from physic_core.interfaces import Segmenter, SegmenterRequest
from physic_core.types import PeoplePrompt
from physic_embedded.segmentation import people as people_module
from physic_embedded.segmenter import EmbeddedSegmenter, EmbeddedSegmenterOptions
from physic_networks.people import Detections

pytestmark = pytest.mark.slow

LEFT = (85.0, 200.0)
RIGHT = (580.0, 250.0)
"""Pixels on the two people of the photo."""


@pytest.fixture(scope="module")
def segmenter():
    backend = EmbeddedSegmenter(EmbeddedSegmenterOptions(threads=1, tile_fractions=()))
    backend.load()
    yield backend
    backend.close()


def test_people_are_in_the_order_of_points_boxes_and_masks(segmenter, image):
    prompt = PeoplePrompt(points=(RIGHT,), boxes=((35.0, 80.0, 160.0, 479.0),))
    found = segmenter.infer(image, prompt)
    assert list(Segmenter.check(found, SegmenterRequest(image, prompt=prompt))) == []
    assert all(found.masks[i, int(y), int(x)] for i, (x, y) in enumerate((RIGHT, LEFT)))
    assert found.keypoints.points[0, 0, 0] > 320 > found.keypoints.points[1, 0, 0]
    mask = np.zeros(image.shape[:2], bool)
    mask[80:470, 40:155] = True
    given = segmenter.infer(image, PeoplePrompt(masks=mask[None]))
    assert np.array_equal(given.masks, mask[None])
    x, y = given.keypoints.points[0, 0]
    assert 60 < x < 110  # the nose lies in the face of the person on the left
    assert 85 < y < 140


def test_prompts_on_nothing_and_twice_on_one_person_are_refused(segmenter, image):
    with pytest.raises(NoPersonError, match=r"point 2 \(320, 120\)"):
        segmenter.infer(image, PeoplePrompt(points=(LEFT, (320.0, 120.0))))
    with pytest.raises(NoPersonError, match="hit the same person"):
        segmenter.infer(image, PeoplePrompt(points=(LEFT, (90.0, 250.0))))


def test_a_stranger_changes_no_joint_of_sure_people(pytestconfig, monkeypatch):
    """A weak box on the ground makes BlazePose search the whole photo."""
    photo = cv2.imread(str(pytestconfig.rootpath / "examples" / "couple.jpg"))
    image = np.ascontiguousarray(
        cv2.resize(photo, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)[..., ::-1]
    )
    find = people_module.detect_boxes

    def detect_with_stranger(*args, **kwargs):
        boxes = find(*args, **kwargs)
        everybody = np.vstack([boxes.people.boxes, [700.0, 500.0, 800.0, 620.0]])
        return boxes._replace(people=Detections(everybody, np.append(boxes.people.scores, 0.35)))

    backend = EmbeddedSegmenter(EmbeddedSegmenterOptions(threads=1))
    backend.load()
    alone = backend.infer(image)
    monkeypatch.setattr(people_module, "detect_boxes", detect_with_stranger)
    beside = backend.infer(image)
    backend.close()
    assert len(alone) == 2
    for name in ("world", "points"):
        one, other = (getattr(found.keypoints, name)[:2] for found in (alone, beside))
        assert np.array_equal(one, other)
