"""Boxes: their forms, their overlap, and which of several mean one thing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physic_core.adapters.detections import (
    box_iou,
    clip_boxes,
    nms,
    xyxy_from_cxcywh,
)


def test_a_centred_box_has_its_corners_half_its_size_away():
    assert xyxy_from_cxcywh(np.array([[10.0, 20.0, 4.0, 6.0]])).tolist() == [[8, 17, 12, 23]]


def test_iou_of_known_boxes():
    one = np.array([[0.0, 0, 10, 10]])
    others = np.array([[0.0, 0, 10, 10], [5, 0, 15, 10], [10, 0, 20, 10], [3, 3, 3, 3], [-5, -5, 15, 15]])
    assert box_iou(one, others)[0] == pytest.approx([1, 1 / 3, 0, 0, 1 / 4])


@given(st.lists(st.tuples(*[st.floats(0, 50)] * 4, st.floats(0, 1)), max_size=12), st.floats(0.05, 0.95))
def test_nms_keeps_what_a_plain_loop_keeps(rows, overlap):
    table = np.array(rows, float).reshape(-1, 5)
    boxes, scores = xyxy_from_cxcywh(table[:, :4]), table[:, 4]
    kept: list[int] = []
    for i in sorted(range(len(rows)), key=lambda i: (-scores[i], i)):
        if all(box_iou(boxes[i : i + 1], boxes[k : k + 1])[0, 0] <= overlap for k in kept):
            kept.append(i)
    assert nms(boxes, scores, overlap).tolist() == kept


def test_boxes_are_cut_at_the_photo_and_vanish_outside():
    boxes = np.array([[-5.0, -5, 30, 10], [90, 10, 130, 70], [120, 0, 140, 10], [np.nan, 0, 1, 1]])
    inside, stay = clip_boxes(boxes, 60, 100)
    assert inside[:2].tolist() == [[0, 0, 30, 10], [90, 10, 100, 60]]
    assert stay.tolist() == [True, True, False, False]
