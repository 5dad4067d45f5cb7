"""People whom the user chose, people who are covered by others, and boxes of people without a
pose.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from physic_core.errors import NoPersonError
from physic_core.interfaces import Segmenter, SegmenterRequest
from physic_core.types import PeoplePrompt, SurfaceLabels, UnposedPerson
from physic_embedded.networks.crops import RotatedSquare
from physic_embedded.networks.mobile_sam import ImageEmbedding, MaskProposals
from physic_embedded.segmentation import people as people_module
from physic_embedded.segmentation import unposed
from physic_embedded.segmentation.hidden_people import GREY, grey_out
from physic_embedded.segmentation.unposed import segment_unposed
from physic_embedded.segmenter import EmbeddedSegmenter, EmbeddedSegmenterOptions
from physic_networks.people import Detections

from .test_segmenter import pose_at

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


def test_the_mask_of_a_pose_is_covered_in_grey():
    square = RotatedSquare(np.array([50.0, 40.0]), 40.0, 0.0)
    mask = np.full((256, 256), -1.0)
    mask[:, 128:] = 1.0  # the right half of the square
    pose = replace(pose_at(square.center), mask=mask, square=square)
    image = np.zeros((100, 100, 3), np.uint8)
    rows, columns = np.nonzero(grey_out(image, [pose])[..., 0] == GREY)
    extent = [rows.min(), rows.max(), columns.min(), columns.max()]
    assert extent == pytest.approx([20, 59, 50, 69], abs=1)
    assert not image.any()


def test_boxes_of_people_who_have_a_pose_and_of_chairs_are_left_out(monkeypatch):
    """MobileSAM's mask is the box itself here."""
    embedding = ImageEmbedding(np.zeros((1, 256, 64, 64)), 100, 200, 1024 / 200)

    def predict_masks(session, embedding, inside, outside, box):
        grid = np.stack(np.meshgrid(*embedding.grid_axes()), axis=-1)
        logits = np.where(
            (grid >= box[:2] - 0.5).all(-1) & (grid < box[2:] - 0.5).all(-1), 1.0, -1.0
        )
        return MaskProposals(np.stack([logits] * 4), np.ones(4), logits)

    monkeypatch.setattr(unposed, "predict_masks", predict_masks)
    people = np.zeros((100, 200), bool)
    people[:, :50] = True
    labels = np.zeros((100, 200), np.uint8)
    labels[:, 150:] = 1
    labels[:, 60:78] = 1
    surfaces = SurfaceLabels(labels, ("seat", "person"))
    boxes = [
        UnposedPerson((10.0, 0.0, 60.0, 90.0), 0.9, "somebody with a pose"),
        UnposedPerson((80.0, 10.0, 120.0, 90.0), 0.6, "a chair"),
        UnposedPerson((80.0, 10.0, 120.0, 90.0), 0.7, "sure"),
        UnposedPerson((150.0, 10.0, 190.0, 90.0), 0.4, "labelled"),
        UnposedPerson((152.0, 12.0, 190.0, 90.0), 0.39, "the same again"),
        UnposedPerson((60.0, 60.0, 75.0, 90.0), 0.65, "sure, with another's hand"),
        UnposedPerson((60.0, 10.0, 75.0, 40.0), 0.64, "the other's hand"),
    ]
    points = np.full((33, 2), 20.0)
    points[[11, 12], 1] = 10.0
    points[[23, 24], 1] = 50.0
    points[[15, 16]] = [[65.0, 20.0], [65.0, 70.0]]
    square = RotatedSquare(np.array([30.0, 40.0]), 100.0, 0.0)
    nothing = np.zeros((64, 64))
    somebody = replace(pose_at(square.center), points=points, mask=nothing, square=square)
    found, mask = segment_unposed(None, embedding, boxes, [somebody], people, surfaces)
    assert [one.reason for one in found] == ["sure", "sure, with another's hand", "labelled"]
    assert found[2].box == pytest.approx([150, 10, 190, 90], abs=1)
    assert mask[50, [100, 170]].all()
    assert not (mask & people).any()


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
