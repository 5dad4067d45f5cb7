"""DeepLabv3 on ADE20K: surfaces lie where the network has its logits, and people are not a surface
of their own.
"""

from __future__ import annotations

import numpy as np

from physic_core.types import SURFACE_NAMES
from physic_embedded.networks.ade20k import label_surfaces
from physic_embedded.networks.sessions import open_packaged_session

FLOOR, WALL, PERSON, SEAT = (
    SURFACE_NAMES.index(name) for name in ("floor", "wall", "person", "seat")
)


class Network:
    """Class 4 (floor) where the input is red, class 1 (wall) elsewhere, with a given margin of the
    logits.
    """

    def __init__(self, margin=8.0):
        self.margin = margin
        self.input = np.zeros((0,), np.float32)

    def run(self, names, inputs):
        assert names == ["logits"]
        self.input = inputs["image"][0]
        red = self.input[::4, ::4, 0] > 200
        logits = np.zeros((1, 128, 128, 32), np.float32)
        logits[..., 0] = 100  # is not a class
        logits[0, ..., 4] = np.where(red, self.margin, 0)
        logits[0, ..., 1] = np.where(red, 0, self.margin)
        return [logits]


def photo(rows=300, columns=600, below=180):
    image = np.full((rows, columns, 3), 90, np.uint8)
    image[below:] = (255, 0, 0)
    return image


NO_PEOPLE = np.zeros((300, 600), bool)


def test_a_surface_lies_at_the_pixels_of_its_logits():
    """One cell of the grid is 4.7 px of this photo."""
    labels = label_surfaces(Network(), photo(), NO_PEOPLE)[0].labels
    assert (labels[:175] == WALL).all()
    assert (labels[185:] == FLOOR).all()


def test_paintings_and_mirrors_are_walls_and_framed():
    class Framed(Network):
        def run(self, names, inputs):
            (logits,) = super().run(names, inputs)
            logits[0, :, :64, 23] = logits[0, :, 64:, 28] = 20
            return [logits]

    surfaces, framed = label_surfaces(Framed(), photo(), NO_PEOPLE)
    assert framed.all()
    assert surfaces.mask("wall").all()
    assert not label_surfaces(Network(), photo(), NO_PEOPLE)[1].any()


def test_the_court_of_the_example_is_floor_or_ground(image):
    session = open_packaged_session("deeplabv3_mnv2_ade20k", 1)
    surfaces, _ = label_surfaces(session, image, np.zeros(image.shape[:2], bool))
    court = surfaces.mask("floor", "ground")
    assert court[-10:].mean() > 0.8
    assert court[: len(court) // 4].mean() < 0.05
