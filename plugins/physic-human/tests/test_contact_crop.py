"""The picture of one person for DECO-like networks."""

from __future__ import annotations

import numpy as np
import pytest

from physic_human.deco import contact_crop, enlarged_box_slices

MEAN, STD = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])


def colours(crop: np.ndarray) -> np.ndarray:
    """Grey levels (256, 256, 3) as the network was given them."""
    return 255 * (crop.transpose(1, 2, 0) * STD + MEAN)


def test_channels_come_as_blue_green_red() -> None:
    image = np.zeros((50, 50, 3), np.uint8)
    image[:] = [200, 100, 10]
    middle = colours(contact_crop(image, np.array([0.0, 0, 50, 50])))[128, 128]
    np.testing.assert_allclose(middle, [10, 100, 200], atol=0.1)


def test_the_box_grows_by_a_tenth_on_every_side_and_ends_at_the_image() -> None:
    assert enlarged_box_slices(np.array([100.0, 50, 200, 250]), 480, 640) == (slice(30, 270), slice(90, 210))
    assert enlarged_box_slices(np.array([0.0, 400, 640, 480]), 480, 640) == (slice(392, 480), slice(0, 640))


def test_the_rest_is_white_and_the_person_in_the_middle() -> None:
    image = np.zeros((300, 300, 3), np.uint8)
    seen = colours(contact_crop(image, np.array([100.0, 50, 150, 250]), growth=0.0))
    np.testing.assert_allclose(seen[:, :95], 255, atol=0.1)
    np.testing.assert_allclose(seen[:, 161:], 255, atol=0.1)
    np.testing.assert_allclose(seen[:, 97:159], 0, atol=0.1)


def test_a_squashed_crop_has_no_white() -> None:
    image = np.zeros((300, 300, 3), np.uint8)
    seen = colours(contact_crop(image, np.array([100.0, 50, 150, 250]), fit="squash"))
    np.testing.assert_allclose(seen, 0, atol=0.1)


def test_the_crop_keeps_left_and_top() -> None:
    image = np.zeros((256, 256, 3), np.uint8)
    image[:100, :60] = 255
    seen = colours(contact_crop(image, np.array([0.0, 0, 256, 256]), growth=0.0))
    assert seen[50, 30].min() > 250
    assert seen[30, 200].max() < 5


@pytest.mark.parametrize("box", [[10.0, 10, 10, 10], [-50.0, -50, -20, -20], [900.0, 900, 950, 990], [3.0, 4, 3.4, 90]])
def test_boxes_without_pixels_still_give_a_crop(box: list[float]) -> None:
    crop = contact_crop(np.full((40, 60, 3), 7, np.uint8), np.array(box))
    assert crop.shape == (3, 256, 256)
    assert crop.dtype == np.float32
    assert np.isfinite(crop).all()
