"""Metric depth of a canonical camera, and the camera that is given."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.types import Hints, Intrinsics
from physic_networks.canonical_depth import (
    depth_from_canonical_inverse,
    focal_from_fov,
    known_camera,
)


@pytest.mark.parametrize("fov", [0.0, -10.0, 180.0, float("nan")])
def test_an_impossible_angle_is_refused(fov):
    with pytest.raises(ValueError, match="the field of view must be between 0 and 180 degrees"):
        focal_from_fov(fov, 100)


def test_inverse_depth_of_the_canonical_camera_becomes_metres():
    # A camera whose focal length is its width needs no factor.
    assert depth_from_canonical_inverse(np.array([[0.5]]), 640.0, 640).tolist() == [[2.0]]
    # Twice the focal length sees the same picture from twice as far.
    assert depth_from_canonical_inverse(np.array([[0.5]]), 1280.0, 640).tolist() == [[4.0]]


def test_inverse_depth_is_clipped_after_the_factor_not_before():
    metres = depth_from_canonical_inverse(
        np.array([[0.0, -1.0, 5e-5, 1e9]], np.float32), 320.0, 640
    )
    np.testing.assert_allclose(metres, [[1e4, 1e4, 1e4, 1e-4]], rtol=1e-5)
    assert metres.dtype == np.float32


IMAGE = np.zeros((100, 200, 3), np.uint8)


def test_a_known_camera_follows_the_size_of_the_image():
    camera = known_camera(Hints(intrinsics=Intrinsics.from_focal(300.0, 400, 200)), IMAGE)
    assert (camera.fx, camera.width, camera.height) == (150.0, 200, 100)
    assert known_camera(Hints(), IMAGE) is None
