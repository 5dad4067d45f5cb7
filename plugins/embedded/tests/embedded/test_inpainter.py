from __future__ import annotations

import numpy as np
import pytest

from physic_embedded.inpainter import MiGan, MiGanOptions


@pytest.fixture(scope="module")
def inpainter():
    backend = MiGan(MiGanOptions(threads=1))
    backend.load()
    return backend


def scene(height, width):
    """A bright wall over a darker floor."""
    image = np.full((height, width, 3), 190, np.uint8)
    image[height // 2 :] = (120, 90, 60)
    return image


def test_an_object_in_front_of_a_wall_is_removed(inpainter):
    image = scene(400, 500)
    mask = np.zeros((400, 500), bool)
    mask[100:300, 220:280] = True
    red = image.copy()
    red[mask] = (255, 0, 0)
    filled = inpainter.infer(red, mask).astype(float)
    assert np.abs(filled - image)[mask].mean() < 4


def test_a_mask_that_leaves_one_pixel_is_still_filled(inpainter):
    image = scene(300, 400)
    mask = np.ones((300, 400), bool)
    mask[0, 0] = False
    filled = inpainter.infer(image, mask)
    np.testing.assert_array_equal(filled[0, 0], image[0, 0])
