"""People in boxes, and a segmenter that knows them."""

from __future__ import annotations

import numpy as np

from physic_core.types import People


class KnownBoxes:
    """A segmenter that finds people in the boxes that it is given."""

    def __init__(self, boxes=()):
        self.boxes = boxes

    def infer(self, image):
        return people(*self.boxes, size=image.shape[:2])

    def close(self):
        pass


PLACES = [(90.0, 60.0), (120.0, 110.0), (75.0, 150.0)]
BOX = (50.0, 20.0, 150.0, 180.0)


def people(*boxes, size=(200, 260)):
    """People with these boxes, in a photo of this height and width."""
    return People(
        np.zeros((len(boxes), *size), bool),
        np.array(boxes, float).reshape(-1, 4),
        np.ones(len(boxes)),
    )


def blobs(places, size=(200, 260), sigma=9.0):
    """A photo with a red, a green and a blue blob."""
    y, x = np.mgrid[: size[0], : size[1]]
    apart = [(x - u) ** 2 + (y - v) ** 2 for u, v in places]
    return np.stack([255 * np.exp(-square / (2 * sigma**2)) for square in apart], -1).astype(
        np.uint8
    )
