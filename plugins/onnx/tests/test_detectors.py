"""Boxes of people from the files of YOLOX, RT-DETR and RTMO."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.errors import BackendError
from physic_onnx.detectors import Detector

SIDE = 64
CELLS = 8 * 8 + 4 * 4 + 2 * 2
GREY = np.full((SIDE, SIDE, 3), 128, np.uint8)


def row(x=0.0, y=0.0, w=0.0, h=0.0, something=0.9, person=0.9, others=0.0):
    return [x, y, w, h, something, person, *[others] * 79]


def raw(*placed, cells=CELLS):
    """The head's answer: nothing but what is placed at (cell, row)."""
    rows = np.tile(np.array(row(something=0.0, person=0.0), np.float32), (cells, 1))
    for cell, values in placed:
        rows[cell] = values
    return rows[None]


@pytest.fixture
def found_of(stand_in_network):
    """What the detector of a network that answers constants finds, and what that was fed."""

    def make(name, photo=GREY, score=0.45, **outputs):
        network = stand_in_network({name: ("float32", ("batch", 3, SIDE, SIDE))}, outputs)
        return Detector(network).infer(photo, score, 0.65), network.fed[name]

    return make


@pytest.fixture
def yolox(found_of):
    """What a YOLOX that answers these rows finds."""
    return lambda rows, score=0.5: found_of("images", score=score, output=rows)[0]


def test_a_raw_head_is_decoded(yolox):
    """Cell 3, 2 of stride 8: the centre is (offset + cell) * stride, the sides are e to the
    power.
    """
    found = yolox(raw((2 * 8 + 3, row(0.5, 0.25, np.log(2), np.log(3)))))
    assert found.boxes[0] == pytest.approx([28 - 8, 18 - 12, 28 + 8, 18 + 12])
    assert found.scores == pytest.approx([0.81])


def test_other_strides_have_their_own_cells(yolox):
    placed = [(64 + 4 + 2, row(0.5, 0.5)), (64 + 16 + 3, row(0.5, 0.5))]
    found = yolox(raw(*placed))
    assert sorted(found.boxes.tolist()) == [[32, 16, 48, 32], [32, 32, 64, 64]]


def test_a_head_that_is_decoded_inside_is_not_decoded_twice(yolox):
    rows = raw()
    rows[0, :, :2] = 31.0
    rows[0, :, 2:4] = 10.0
    rows[0, 5] = row(20, 30, 10, 20)
    assert yolox(rows).boxes.tolist() == [[15, 20, 25, 40]]


def test_boxes_of_one_person_are_one(yolox):
    placed = [
        (19, row(0.5, 0.5, 1, 1)),
        (20, row(-0.4, 0.5, 1, 1, person=0.8)),
        (22, row(0.5, 0.5, 0, 0)),
    ]
    found = yolox(raw(*placed))
    assert found.scores == pytest.approx([0.81, 0.81])


def test_boxes_of_other_classes_are_no_people(yolox):
    chair = row(0.5, 0.5, 1, 1, person=0.05, others=0.95)
    assert not len(yolox(raw((19, chair)), 0.3))


def test_yolox_gets_bgr_grey_levels_at_the_top_left_and_grey_elsewhere(found_of):
    photo = np.full((SIDE // 2, SIDE, 3), [10, 20, 250], np.uint8)
    _, (seen,) = found_of("images", photo, output=raw())
    assert (seen[:, : SIDE // 2].transpose(1, 2, 0) == [250, 20, 10]).all()
    assert (seen[:, SIDE // 2 :] == 114).all()


WIDE = np.zeros((60, 128, 3), np.uint8)
"""A photo twice as wide as the frame: the letterbox is undone by its scale alone."""


@pytest.mark.parametrize("labels", [{}, {"labels": [[0, 0]]}])
def test_boxes_chosen_inside_are_taken_to_the_photo(found_of, labels):
    dets = [[[10, 5, 20, 25, 0.9], [30, 5, 40, 25, 0.2]]]
    found, _ = found_of("input", WIDE, dets=dets, **labels)
    assert found.boxes == pytest.approx(np.array([[20.0, 10, 40, 50]]))


def test_rtmo_gives_joints_too(found_of):
    """The centre of the frame's pixel 12 is 12.5 from its edge, so 25 from the photo's edge: pixel
    24.5.
    """
    joints = np.zeros((1, 1, 17, 3))
    joints[0, 0, 15] = 12, 20, 0.7
    found, _ = found_of("input", WIDE, dets=[[[10, 5, 20, 25, 0.9]]], keypoints=joints)
    assert found.keypoints is not None
    assert found.keypoints.skeleton == "coco17"
    assert found.keypoints.points[0, 15] == pytest.approx([23.5, 39.5])
    assert found.keypoints.confidence[0, 15] == pytest.approx(0.7)


def test_rt_detr_has_centred_boxes_in_shares_of_the_photo_and_gets_squashed_rgb(found_of):
    logits = np.full((1, 300, 80), -9.0)
    logits[0, 7, 0] = 2.0
    logits[0, 8, 56] = 9.0
    boxes = np.full((1, 300, 4), 0.5)
    boxes[0, 7] = 0.5, 0.25, 0.2, 0.5
    photo = np.full((100, 200, 3), [204, 51, 0], np.uint8)
    found, (seen,) = found_of("pixel_values", photo, logits=logits, pred_boxes=boxes)
    assert found.boxes == pytest.approx(np.array([[80.0, 0, 120, 50]]))
    assert found.scores == pytest.approx([1 / (1 + np.exp(-2))])
    np.testing.assert_allclose(seen.transpose(1, 2, 0) - [0.8, 0.2, 0], 0, atol=1e-6)


def test_another_file_is_refused_with_its_inputs_and_outputs(found_of):
    with pytest.raises(BackendError) as raised:
        found_of("picture", answer=np.zeros((1, 4)))
    for text in (
        "expected of RTMO",
        "expected of YOLOX",
        "expected of RT-DETR",
        "picture float32 (batch, 3, 64, 64)",
    ):
        assert text in str(raised.value)


def test_no_detections_are_an_empty_array(found_of):
    assert found_of("input", dets=np.zeros((1, 0, 5)))[0].boxes.shape == (0, 4)
