"""Boxes and masks of detectors become people."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from physic_core.backends.people import box_iou
from physic_core.interfaces import Segmenter
from physic_core.types import Keypoints
from physic_networks.people import (
    clip_boxes,
    nms,
    people_from_masks,
    xyxy_from_cxcywh,
)
from physic_testing import violations


@given(
    st.lists(st.tuples(*[st.floats(0, 50)] * 4, st.floats(0, 1)), max_size=12),
    st.floats(0.05, 0.95),
)
def test_nms_keeps_what_a_plain_loop_keeps(rows, overlap):
    table = np.array(rows, float).reshape(-1, 5)
    boxes = xyxy_from_cxcywh(table[:, :4])
    scores = table[:, 4]
    kept = []
    for i in sorted(range(len(rows)), key=lambda i: (-scores[i], i)):
        if all(box_iou(boxes[i : i + 1], boxes[k : k + 1])[0, 0] <= overlap for k in kept):
            kept.append(i)
    assert nms(boxes, scores, overlap).tolist() == kept


def test_boxes_are_cut_at_the_photo_and_vanish_outside():
    boxes = np.array([[-5.0, -5, 30, 10], [90, 10, 130, 70], [120, 0, 140, 10], [np.nan, 0, 1, 1]])
    inside, stay = clip_boxes(boxes, 60, 100)
    assert inside[:2].tolist() == [[0, 0, 30, 10], [90, 10, 100, 60]]
    assert stay.tolist() == [True, True, False, False]


SIZE = (6, 8)


def rectangle(y0, y1, x0, x1, value=1.0, outside=-1.0):
    mask = np.full(SIZE, outside, np.float32)
    mask[y0:y1, x0:x1] = value
    return mask


def test_a_pixel_goes_to_the_largest_logit():
    people = people_from_masks(
        [rectangle(0, 4, 0, 5), rectangle(2, 6, 2, 8, 2.0)], None, np.array([0.9, 0.8]), size=SIZE
    )
    assert not (people.masks[0] & people.masks[1]).any()
    assert people.masks[1].sum() == 24
    assert people.masks[0].sum() == 20 - 6


def test_people_without_pixels_are_dropped_and_the_best_score_comes_first():
    masks = [rectangle(0, 2, 0, 2), rectangle(0, 0, 0, 0), rectangle(4, 6, 4, 6)]
    joints = Keypoints(np.arange(6.0).reshape(3, 1, 2), np.ones((3, 1)), "one")
    people = people_from_masks(masks, None, np.array([0.5, 0.9, 0.8]), size=SIZE, keypoints=joints)
    assert people.scores.tolist() == [0.8, 0.5]
    assert people.masks[0][5, 5]
    assert people.keypoints is not None
    assert people.keypoints.points[:, 0, 0].tolist() == [4, 0]


@given(
    arrays(
        np.float32,
        st.tuples(st.integers(0, 4), st.just(6), st.just(8)),
        elements=st.floats(-3, 3, width=32),
    ),
    st.booleans(),
)
def test_any_mask_gives_a_valid_result(logits, sharp):
    masks = logits > 0 if sharp else logits
    people = people_from_masks(
        list(masks), None, np.linspace(0.9, 0.1, len(masks)), np.ones(SIZE, bool), size=SIZE
    )
    assert violations(Segmenter, people, height=SIZE[0], width=SIZE[1]) == []
    assert (people.masks.any(0) == (logits > 0).any(0)).all() if len(masks) else len(people) == 0
