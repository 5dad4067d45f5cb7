"""Things in hands: whose hand, and only with a clear border."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.types import Keypoints, People
from physic_embedded.networks.mobile_sam import ImageEmbedding
from physic_embedded.segmentation.held import segment_held

SIZE = 256  # px of the photo, and cells of the decoder's masks
EMBEDDING = ImageEmbedding(np.zeros((1, 256, 64, 64), np.float32), SIZE, SIZE, 4.0)
LEFT = 15
RIGHT = 16


class Decoder:
    """Answers with the box of the prompt, its border so steep and its overlap so good."""

    def __init__(self, logit=8.0, iou=0.95):
        self.logit = logit
        self.iou = iou

    def run(self, names, inputs):
        x0, y0, x1, y1 = (inputs["point_coords"][0].ravel() / 4).round().astype(int)
        raw = np.full((1, 4, SIZE, SIZE), -self.logit, np.float32)
        raw[:, :, y0:y1, x0:x1] = self.logit
        return raw, np.full((1, 4), self.iou, np.float32)


def person(confidence=0.9):
    """One person with a trunk of 60 px, the left hand at (100, 100), the right one at (40, 100)."""
    points = np.zeros((1, 33, 2))
    points[0, 11:13] = 70, 70
    points[0, 23:25] = 70, 130
    points[0, [LEFT, 17, 19]] = 100, 100
    points[0, [RIGHT, 18, 20]] = 40, 100
    mask = np.zeros((1, SIZE, SIZE), bool)
    mask[0, 50:200, 55:105] = True
    boxes = np.array([[55, 50, 105, 200]], np.float32)
    keypoints = Keypoints(points, np.full((1, 33), confidence), "blazepose33")
    return People(mask, boxes, np.ones(1, np.float32), keypoints=keypoints)


@pytest.mark.parametrize(
    ("box", "side"), [((95, 95, 180, 110), 0), ((5, 95, 50, 110), 1), ((20, 90, 180, 100), 1)]
)
def test_a_thing_belongs_to_the_nearest_hand_and_no_pixel_to_the_person(box, side):
    people = person()
    held = segment_held(Decoder(), EMBEDDING, np.array([box], float), people)
    x0, y0, x1, y1 = box
    thing = np.zeros((SIZE, SIZE), bool)
    thing[y0 - 1 : y1 + 1, x0 - 1 : x1 + 1] = True
    free = ~people.masks[0]
    assert (held[0, side] & thing).sum() > 0.95 * (thing & free).sum()
    assert not (held[0, side] & ~(thing & free)).any()
    assert not held[0, 1 - side].any()


@pytest.mark.parametrize(
    ("decoder", "people", "box"),
    [
        (Decoder(), person(), (160, 95, 200, 110)),  # out of reach
        (Decoder(), person(confidence=0.3), (95, 95, 180, 110)),  # a hand that is not seen
        (Decoder(logit=0.8), person(), (95, 95, 180, 110)),  # a border that is not clear
        (Decoder(iou=0.7), person(), (95, 95, 180, 110)),
        (Decoder(), person(), (60, 60, 90, 110)),  # on the person
    ],
)
def test_nothing_is_held_without_a_seen_hand_and_a_clear_border(decoder, people, box):
    assert segment_held(decoder, EMBEDDING, np.array([box], float), people) is None
