"""Boxes of people from the files of YOLOX, RT-DETR and RTMO: graphs of their contract, run by
onnxruntime.
"""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.errors import BackendError
from physic_onnx.detectors import open_detector
from physic_onnx.sessions import OnnxOptions

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
def answering(constant_graph, tmp_path):
    """A detector whose file answers constants, whatever it sees."""

    def make(name, shape, **outputs):
        path = constant_graph(tmp_path / "detector.onnx", {name: ("float32", shape)}, **outputs)
        return open_detector(path, OnnxOptions(threads=1), "cpu")

    return make


@pytest.fixture
def found_of(answering):
    """What a YOLOX file that answers these rows finds."""

    def find(rows, score=0.5):
        detector = answering("images", (1, 3, SIDE, SIDE), output=rows)
        assert detector.signature == "YOLOX"
        return detector.infer(GREY, score, 0.65)

    return find


@pytest.fixture
def scoring(graph, node, tmp_path):
    """A YOLOX file that sees a person in one place with a score of one value of its input over
    ``over``.
    """

    def make(place, over):
        channel, y, x = place
        nodes = [
            node("Slice", ["images", "start", "end"], ["value"]),
            node("Div", ["value", "over"], ["share"]),
            node("Reshape", ["share", "scalar"], ["score"]),
            node("Mul", ["where", "score"], ["scored"]),
            node("Add", ["rest", "scored"], ["output"]),
        ]
        rest = raw((27, row(0.5, 0.5, 0.5, 0.5, something=1.0, person=0.0)))
        where = np.zeros((1, CELLS, 85), np.float32)
        where[0, 27, 5] = 1
        constants = {
            "start": np.array([0, channel, y, x]),
            "end": np.array([1, channel + 1, y + 1, x + 1]),
            "over": np.float32(over),
            "scalar": np.array([1]),
            "where": where,
            "rest": rest,
        }
        path = graph(
            tmp_path / "yolox.onnx",
            {"images": ("float32", (1, 3, SIDE, SIDE))},
            {"output": ("float32", (1, CELLS, 85))},
            nodes,
            constants,
        )
        return open_detector(path, OnnxOptions(threads=1), "cpu")

    return make


def test_a_raw_head_is_decoded(found_of):
    """Cell 3, 2 of stride 8: the centre is (offset + cell) * stride, the sides are e to the
    power.
    """
    found = found_of(raw((2 * 8 + 3, row(0.5, 0.25, np.log(2), np.log(3)))))
    assert found.boxes[0] == pytest.approx([28 - 8, 18 - 12, 28 + 8, 18 + 12])
    assert found.scores == pytest.approx([0.81])


def test_other_strides_have_their_own_cells(found_of):
    placed = [(64 + 4 + 2, row(0.5, 0.5)), (64 + 16 + 3, row(0.5, 0.5))]
    found = found_of(raw(*placed))
    assert sorted(found.boxes.tolist()) == [[32, 16, 48, 32], [32, 32, 64, 64]]


def test_a_head_that_is_decoded_inside_is_not_decoded_twice(found_of):
    rows = raw()
    rows[0, :, :2] = 31.0
    rows[0, :, 2:4] = 10.0
    rows[0, 5] = row(20, 30, 10, 20)
    assert found_of(rows).boxes.tolist() == [[15, 20, 25, 40]]


def test_boxes_of_one_person_are_one(found_of):
    placed = [
        (19, row(0.5, 0.5, 1, 1)),
        (20, row(-0.4, 0.5, 1, 1, person=0.8)),
        (22, row(0.5, 0.5, 0, 0)),
    ]
    found = found_of(raw(*placed))
    assert found.scores == pytest.approx([0.81, 0.81])


def test_boxes_of_other_classes_are_no_people(found_of):
    chair = row(0.5, 0.5, 1, 1, person=0.05, others=0.95)
    assert not len(found_of(raw((19, chair)), 0.3))


def test_yolox_gets_bgr_grey_levels(scoring):
    """BGR from 0 to 255: the first channel of a blue photo is 255."""
    blue = np.zeros((SIDE, SIDE, 3), np.uint8)
    blue[..., 2] = 255
    assert scoring((0, 5, 5), 255.0).infer(blue, 0.5, 0.65).scores == pytest.approx([1.0])
    assert not len(scoring((2, 5, 5), 255.0).infer(blue, 0.1, 0.65))


def test_yolox_sees_the_photo_at_the_top_left_and_grey_elsewhere(scoring):
    photo = np.full((SIDE // 2, SIDE, 3), 250, np.uint8)
    for y, x, level in ((0, 0, 250.0), (SIDE // 2 - 1, 0, 250.0), (SIDE - 1, SIDE - 1, 114.0)):
        found = scoring((0, y, x), level).infer(photo, 0.5, 0.65)
        assert found.scores == pytest.approx([1.0])


@pytest.mark.parametrize("labels", [False, True])
def test_boxes_chosen_inside_are_taken_to_the_photo(answering, labels):
    """A photo twice as wide as the frame: the letterbox is undone by its scale alone."""
    dets = [[[10, 5, 20, 25, 0.9], [30, 5, 40, 25, 0.2]]]
    outputs = {"dets": dets, "labels": [[0, 0]]} if labels else {"dets": dets}
    detector = answering("input", ("batch", 3, SIDE, SIDE), **outputs)
    assert detector.signature == "YOLOX with NMS inside"
    found = detector.infer(np.zeros((60, 128, 3), np.uint8), 0.45, 0.65)
    assert found.boxes == pytest.approx(np.array([[20.0, 10, 40, 50]]))


def test_rtmo_gives_joints_too(answering):
    """The centre of the frame's pixel 12 is 12.5 from its edge, so 25 from the photo's edge: pixel
    24.5.
    """
    joints = np.zeros((1, 1, 17, 3))
    joints[0, 0, 15] = 12, 20, 0.7
    detector = answering(
        "input", ("batch", 3, SIDE, SIDE), dets=[[[10, 5, 20, 25, 0.9]]], keypoints=joints
    )
    assert detector.signature == "RTMO"
    found = detector.infer(np.zeros((60, 128, 3), np.uint8), 0.45, 0.65)
    assert found.keypoints is not None
    assert found.keypoints.skeleton == "coco17"
    assert found.keypoints.points[0, 15] == pytest.approx([23.5, 39.5])
    assert found.keypoints.confidence[0, 15] == pytest.approx(0.7)


def test_rt_detr_has_centred_boxes_in_shares_of_the_photo(answering):
    logits = np.full((1, 300, 80), -9.0)
    logits[0, 7, 0] = 2.0
    logits[0, 8, 56] = 9.0
    boxes = np.full((1, 300, 4), 0.5)
    boxes[0, 7] = 0.5, 0.25, 0.2, 0.5
    detector = answering("pixel_values", ("batch", 3, SIDE, SIDE), logits=logits, pred_boxes=boxes)
    assert detector.signature == "RT-DETR"
    found = detector.infer(np.zeros((100, 200, 3), np.uint8), 0.45, 0.65)
    assert found.boxes == pytest.approx(np.array([[80.0, 0, 120, 50]]))
    assert found.scores == pytest.approx([1 / (1 + np.exp(-2))])


def test_rt_detr_gets_squashed_rgb_from_0_to_1(graph, node, tmp_path):
    """A graph whose person's logit is ten times the last value of the first channel: no mean, no
    deviation, no rim.
    """
    where = np.zeros((1, 3, 80), np.float32)
    where[0, 0, 0] = 10
    nodes = [
        node("Slice", ["pixel_values", "start", "end"], ["value"]),
        node("Reshape", ["value", "scalar"], ["scalar_value"]),
        node("Mul", ["where", "scalar_value"], ["scored"]),
        node("Sub", ["scored", "five"], ["logits"]),
        node("Identity", ["boxes"], ["pred_boxes"]),
    ]
    constants = {
        "start": np.array([0, 0, SIDE - 1, SIDE - 1]),
        "end": np.array([1, 1, SIDE, SIDE]),
        "scalar": np.array([1]),
        "where": where,
        "five": np.float32(5),
        "boxes": np.full((1, 3, 4), 0.5, np.float32),
    }
    path = graph(
        tmp_path / "detr.onnx",
        {"pixel_values": ("float32", ("batch", 3, SIDE, SIDE))},
        {"logits": ("float32", (1, 3, 80)), "pred_boxes": ("float32", (1, 3, 4))},
        nodes,
        constants,
    )
    photo = np.zeros((30, 90, 3), np.uint8)
    photo[..., 0] = 204
    found = open_detector(path, OnnxOptions(threads=1), "cpu").infer(photo, 0.1, 0.65)
    assert found.scores == pytest.approx([1 / (1 + np.exp(-3.0))], abs=1e-3)


def test_another_file_is_refused_with_its_inputs_and_outputs(answering):
    with pytest.raises(BackendError) as raised:
        answering("picture", (1, 3, SIDE, SIDE), answer=np.zeros((1, 4)))
    for text in (
        "expected of RTMO",
        "expected of YOLOX",
        "expected of RT-DETR",
        "picture float32 (1, 3, 64, 64)",
    ):
        assert text in str(raised.value)


def test_no_detections_are_an_empty_array(answering):
    found = answering("input", ("b", 3, SIDE, SIDE), dets=np.zeros((1, 0, 5))).infer(
        GREY, 0.5, 0.65
    )
    assert found.boxes.shape == (0, 4)
