"""Weak perspective of a crop, and translations in the camera of the photo."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.types import Intrinsics
from physic_human.camerahmr import translation_from_crop

CAMERA = Intrinsics(900.0, 900.0, 319.5, 239.5, 640, 480)


def test_it_is_the_published_formula_where_the_principal_point_is_the_middle() -> None:
    s, tx, ty, side = 0.8, 0.1, -0.3, 150.0
    centre = np.array([402.0, 77.0])
    found = translation_from_crop(np.array([[s, tx, ty]]), centre[None], np.array([side]), CAMERA)[0]
    published = [tx + 2 * (centre[0] - 319.5) / (s * side), ty + 2 * (centre[1] - 239.5) / (s * side)]
    np.testing.assert_allclose(found, [*published, 2 * 900 / (side * s)])


@pytest.mark.parametrize("stretch", [0.8, 1.0, 1.25])
def test_a_body_is_seen_where_its_crop_has_it(stretch: float) -> None:
    camera = Intrinsics(900.0, stretch * 900.0, 300.0, 200.0, 640, 480)
    weak, centres, sides = np.array([[0.9, 0.25, -0.5]]), np.array([[400.0, 100.0]]), np.array([160.0])
    x, y, z = translation_from_crop(weak, centres, sides, camera)[0]
    seen = [camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy]
    np.testing.assert_allclose(seen, centres[0] + 80 * 0.9 * weak[0, 1:])
