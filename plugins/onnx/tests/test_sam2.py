"""SAM 2: prompts, masks, and feet."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.types import People
from physic_onnx.sam2 import Sam2, Sam2Options
from physic_onnx.sam2_floor import feet_positions
from physic_onnx.sam2_networks import Sam2Networks

from .pose_worlds import KnownBoxes

FEATURES = {
    "high_res_feats_0": (1, 32, 256, 256),
    "high_res_feats_1": (1, 64, 128, 128),
    "image_embed": (1, 256, 64, 64),
}
PROMPT = {
    "point_coords": ("n", "p", 2),
    "point_labels": ("n", "p"),
    "mask_input": ("n", 1, 256, 256),
    "has_mask_input": (1,),
}


@pytest.fixture
def networks_of(stand_in_network):
    """Encoder and decoder; the decoder answers masks of nothing but for ``answer``."""

    def nothing(feed):
        many = len(feed["point_coords"])
        return {"masks": np.zeros((many, 3, 256, 256)), "iou_predictions": np.zeros((many, 3))}

    def make(answer=nothing):
        maps = {name: np.zeros(shape) for name, shape in FEATURES.items()}
        encoder = stand_in_network({"image": (1, 3, 1024, 1024)}, maps)
        return encoder, stand_in_network(PROMPT | FEATURES, answer)

    return make


def standing(boxes, size=(200, 300)):
    masks = np.zeros((len(boxes), *size), bool)
    for mask, (x0, y0, x1, y1) in zip(masks, boxes, strict=True):
        mask[y0:y1, x0:x1] = True
    return People(masks, np.array(boxes, float).reshape(-1, 4), np.full(len(boxes), 0.9))


def test_feet_are_the_lower_ends_of_people_who_are_not_cut_off():
    """Not of those who are cut off by the photo's edge, nor of those who are wider than a standing
    person.
    """
    feet = feet_positions(standing([(20, 20, 60, 160)]))
    assert feet == pytest.approx(np.array([[39.5, 159, 20]]))
    assert not len(feet_positions(standing([(20, 60, 60, 200)])))
    assert not len(feet_positions(standing([(20, 100, 100, 160)])))


def rectangles(feed):
    """Three masks for each box, of which the best is its lower half; points get the lowest rows."""
    y, x = np.mgrid[:256, :256] * 4 + 2
    masks = []
    if feed["point_coords"].shape[1] > 2:
        assert (feed["point_labels"] == 0).sum() == 2  # of two people, who are not the floor
        assert (feed["point_labels"] == 1).any()
    for (x0, y0), (x1, y1) in feed["point_coords"][:, :2]:
        inside = (x > x0) & (x < x1) & (y > y0) & (y < y1)
        whole = np.ones((256, 256), bool)
        best = y > 900 if feed["point_coords"].shape[1] > 2 else inside & (y > (y0 + y1) / 2)
        masks.append([whole, inside, best])
    fits = np.tile([0.6, 0.3, 0.95], (len(masks), 1))
    return {"masks": 20.0 * np.array(masks) - 10, "iou_predictions": fits}


@pytest.mark.parametrize("people", [0, 2])
def test_people_are_the_best_masks_in_their_boxes_and_one_encoding_serves_the_floor(
    networks_of, people
):
    boxes = [(10.0, 20, 50, 180), (60.0, 20, 100, 180)][:people]
    encoder, decoder = networks_of(rectangles)
    backend = Sam2(Sam2Options())
    backend._network = Sam2Networks(encoder, decoder), KnownBoxes(boxes)
    answer = backend.infer(np.zeros((200, 120, 3), np.uint8))
    assert encoder.runs == min(people, 1)
    assert len(answer) == people
    for mask, (x0, y0, x1, y1) in zip(answer.masks, boxes, strict=True):
        rows, columns = np.nonzero(mask)
        edges = [columns.min(), rows.min(), columns.max(), rows.max()]
        assert edges == pytest.approx([x0, (y0 + y1) / 2, x1, y1], abs=2)
    assert (answer.floor is None) == (people == 0)
    if people:
        assert answer.floor[185:].all()
        assert not answer.floor[:170].any()
