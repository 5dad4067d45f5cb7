"""Crops of people and the joints that are read from the output."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from physic_networks.top_down import (
    crop_around_box,
    heatmap_peaks,
    padded_region,
    resample_crop,
    subpixel_peaks,
)


def cut_by_scipy(image, crop):
    """Bilinear between pixel centres, and towards black outside."""
    v, u = np.mgrid[: crop.height, : crop.width]
    places = [crop.origin[1] + v * crop.step[1], crop.origin[0] + u * crop.step[0]]
    planes = [
        map_coordinates(plane, places, order=1, mode="grid-constant")
        for plane in image.astype(float).transpose(2, 0, 1)
    ]
    return np.stack(planes, -1)


def test_a_tall_box_is_widened_and_a_wide_box_heightened():
    middle, size = padded_region(np.array([10.0, 20.0, 30.0, 120.0]), 0.75, 1.0)
    assert middle.tolist() == [19.5, 69.5]
    assert size.tolist() == [75.0, 100.0]
    assert padded_region(np.array([0.0, 0.0, 90.0, 60.0]), 0.75, 1.25)[1].tolist() == [112.5, 150.0]
    crop = crop_around_box(np.array([10.0, 20.0, 30.0, 120.0]), 192, 256, padding=1.0)
    np.testing.assert_allclose(crop.to_photo(np.array([96.0, 128.0])), middle)
    np.testing.assert_allclose(crop.to_photo(np.array([0.0, 0.0])), middle - size / 2)


@given(
    box=st.tuples(*[st.floats(-50, 300)] * 2, *[st.floats(2, 400)] * 2),
    points=st.lists(st.tuples(st.floats(-500, 500), st.floats(-500, 500)), min_size=1, max_size=5),
    mirrored=st.booleans(),
)
def test_points_of_the_crop_map_back_to_the_photo(box, points, mirrored):
    corners = np.array([box[0], box[1], box[0] + box[2], box[1] + box[3]])
    crop = crop_around_box(corners, 192, 256, mirrored=mirrored)
    assert np.allclose(crop.to_photo(crop.to_crop(np.array(points))), points, atol=1e-6)


@pytest.mark.parametrize("mirrored", [False, True])
def test_cutting_equals_its_reference(mirrored):
    image = np.random.default_rng(1).integers(0, 256, (40, 50, 3), np.uint8)
    crop = crop_around_box(np.array([-5.0, 4.0, 30.0, 45.0]), 24, 32, mirrored=mirrored)
    apart = np.abs(resample_crop(image, crop) - cut_by_scipy(image, crop))
    # OpenCV rounds places to 1/32 of a pixel.
    assert apart.max() < 255 / 32 * 2 + 1
    assert apart.mean() < 2


def gaussians(points, height, width, sigma, high=0.9):
    """(N, J, h, w): a Gaussian at each of the points (N, J, 2)."""
    y, x = np.mgrid[:height, :width]
    apart = (x - points[..., 0, None, None]) ** 2 + (y - points[..., 1, None, None]) ** 2
    return high * np.exp(-apart / (2 * sigma**2))


@pytest.mark.parametrize("sigma", [1.5, 2.0, 3.0])
def test_known_peaks_are_found_to_a_twentieth_of_a_cell(sigma):
    true = np.random.default_rng(0).uniform([6, 6], [41, 57], (3, 40, 2))
    found, value = subpixel_peaks(gaussians(true, 64, 48, sigma))
    apart = np.linalg.norm(found - true, axis=-1)
    coarse = np.linalg.norm(heatmap_peaks(gaussians(true, 64, 48, sigma))[0] - true, axis=-1)
    assert apart.max() < 0.05 < coarse.max()
    assert (value > 0.8).all()
    assert (value <= 0.9).all()
