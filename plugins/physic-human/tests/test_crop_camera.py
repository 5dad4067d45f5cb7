"""Weak perspective of a crop, and translations in the camera of the photo."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.types import Intrinsics
from physic_human.crop_camera import translation_from_crop

CAMERA = Intrinsics(900.0, 900.0, 319.5, 239.5, 640, 480)


def test_a_body_at_the_middle_of_its_crop_lies_on_that_pixels_ray() -> None:
    centres, sides = np.array([[100.0, 300.0]]), np.array([200.0])
    found = translation_from_crop(np.array([[0.9, 0.0, 0.0]]), centres, sides, CAMERA)[0]
    np.testing.assert_allclose(found[2], 2 * 900 / (200 * 0.9))
    np.testing.assert_allclose(900 * found[:2] / found[2] + [319.5, 239.5], centres[0])


def test_it_is_the_published_formula_where_the_principal_point_is_the_middle() -> None:
    s, tx, ty, side = 0.8, 0.1, -0.3, 150.0
    centre = np.array([402.0, 77.0])
    found = translation_from_crop(np.array([[s, tx, ty]]), centre[None], np.array([side]), CAMERA)[0]
    published = [tx + 2 * (centre[0] - 319.5) / (s * side), ty + 2 * (centre[1] - 239.5) / (s * side)]
    np.testing.assert_allclose(found, [*published, 2 * 900 / (side * s)])


def test_the_principal_point_counts_and_not_the_middle_of_the_image() -> None:
    shifted = Intrinsics(900.0, 900.0, 250.0, 200.0, 640, 480)
    at_the_principal_point = translation_from_crop(
        np.array([[1.0, 0.0, 0.0]]), np.array([[250.0, 200.0]]), np.array([100.0]), shifted
    )
    np.testing.assert_allclose(at_the_principal_point[0, :2], 0, atol=1e-12)


def test_one_metre_has_as_many_pixels_in_the_photo_as_in_the_crop() -> None:
    weak, centres, sides = np.array([[0.7, 0.2, 0.1]]), np.array([[200.0, 220.0]]), np.array([180.0])
    place = translation_from_crop(weak, centres, sides, CAMERA)[0]
    beside = place + np.array([1.0, 0.0, 0.0])
    pixels = 900 * beside[0] / beside[2] - 900 * place[0] / place[2]
    np.testing.assert_allclose(pixels, 180 / 2 * 0.7)


@pytest.mark.parametrize("stretch", [0.8, 1.25])
def test_pixels_that_are_not_square_are_seen_where_they_are(stretch: float) -> None:
    camera = Intrinsics(900.0, stretch * 900.0, 300.0, 200.0, 640, 480)
    weak, centres, sides = np.array([[0.9, 0.25, -0.5]]), np.array([[400.0, 100.0]]), np.array([160.0])
    x, y, z = translation_from_crop(weak, centres, sides, camera)[0]
    seen = [camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy]
    np.testing.assert_allclose(seen, centres[0] + 80 * 0.9 * weak[0, 1:])
