"""YOLOX: boxes at the cells that predict them, in the full image and in tiles."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.backends.people import box_iou
from physic_embedded.networks.sessions import open_packaged_session
from physic_embedded.networks.yolox import CLASSES, detect_boxes

CELLS = [(52, 8), (26, 16), (13, 32)]


def detect(network, image, min_score=0.4, **options):
    return detect_boxes(network, image, min_score=min_score, min_tile_score=0.5, **options)


class Network:
    """Predicts a thing of a given size at every cell whose pixel is pure red: a person, and classes
    with scores.
    """

    def __init__(self, width, height, **scores):
        self.size = (width, height)
        self.scores = {"person": 0.9, **scores}
        self.inputs = []

    def run(self, names, inputs):
        image = inputs["images"][0]
        self.inputs.append(image)
        rows = np.zeros((1, 3549, 85), np.float32)
        start = 0
        for count, stride in CELLS:
            blue, green, red = image[:, stride // 2 :: stride, stride // 2 :: stride]
            hit = ((red > 250) & (blue < 5) & (green < 5)).ravel()
            part = rows[0, start : start + count * count]
            part[:, :2] = 0.5
            part[:, 2:4] = np.log(np.array(self.size) / stride)
            part[hit, 4] = 1.0
            for name, score in self.scores.items():
                part[hit, 5 + CLASSES[name]] = score
            start += count * count
        return [rows]


def photo(width, height, *marks, side=24):
    """A grey image with red squares round the given pixels."""
    image = np.full((height, width, 3), 100, np.uint8)
    for x, y in marks:
        image[y - side : y + side, x - side : x + side] = (255, 0, 0)
    return image


def test_a_box_lies_at_its_cell_in_the_photo():
    """The photo is twice as large as the input: a box of 60 x 120 px there is 120 x 240 px here."""
    found = detect(Network(60, 120), photo(832, 624, (400, 300))).people
    assert len(found) >= 1
    center = (found.boxes[0, :2] + found.boxes[0, 2:]) / 2
    np.testing.assert_allclose(center, [400, 300], atol=24)
    np.testing.assert_allclose(found.boxes[0, 2:] - found.boxes[0, :2], [120, 240], atol=1e-3)
    np.testing.assert_allclose(found.scores[0], 0.9)


def test_boxes_at_inner_edges_of_tiles_are_dropped_and_at_photo_edges_kept():
    """Tiles of 416 px show the marks at their own size; the full photo of 832 px does not pass
    ``min_score``.
    """
    image = photo(832, 832, (30, 200), (415, 600))
    found = detect(Network(60, 120), image, min_score=0.99, fractions=[0.5]).people
    centers = (found.boxes[:, :2] + found.boxes[:, 2:]) / 2
    assert any(np.linalg.norm(center - [30, 200]) < 40 for center in centers)
    near = found.boxes[np.linalg.norm(centers - [415, 600], axis=1) < 70]
    # The tile in the middle shows all of it. A tile that begins or ends at x = 416 would give a box
    # that is cut off.
    np.testing.assert_allclose(near[:, 2] - near[:, 0], 60, atol=1e-3)
    assert len(near)
    assert (found.boxes >= 0).all()
    assert (found.boxes <= 832).all()


@pytest.mark.parametrize(
    ("name", "score", "replaces", "carries"),
    [
        ("person", 0.9, False, False),
        ("dog", 0.95, True, False),
        ("skateboard", 0.95, True, True),
        ("skateboard", 0.65, False, False),
        ("bicycle", 0.95, False, True),
    ],
)
def test_a_surer_thing_but_a_bicycle_replaces_a_person(name, score, replaces, carries):
    found = detect(Network(60, 120, **{name: score}), photo(416, 416, (200, 200)))
    assert len(found.people) >= 1
    other = found.other_at(found.people.boxes[0], float(found.people.scores[0]), 0.5)
    assert other == (name if replaces else None)
    assert found.other_at(found.people.boxes[0] + 200, 0.0, 0.5) is None
    assert {one.name for one in found.carriers(0.6)} == ({name} if carries else set())


@pytest.mark.parametrize("fractions", [(), (0.5,)])
def test_the_player_of_the_example_photo_is_one_box(image, fractions):
    session = open_packaged_session("yolox_nano", threads=1)
    found = detect(session, image, fractions=fractions).people
    whole = detect(session, image).people
    assert found.scores[0] > 0.7
    assert box_iou(found.boxes[:1], whole.boxes[:1])[0, 0] > 0.8
