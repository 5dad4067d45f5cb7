"""The camera for which a depth map is returned."""

from __future__ import annotations

import numpy as np

from physic_core.adapters.cameras import guessed_camera, known_camera
from physic_core.types import Hints, Intrinsics

IMAGE = np.zeros((100, 200, 3), np.uint8)


def test_a_known_camera_follows_the_size_of_the_image():
    camera = known_camera(Hints(intrinsics=Intrinsics.from_focal(300.0, 400, 200)), IMAGE)
    assert (camera.fx, camera.width, camera.height) == (150.0, 200, 100)
    assert known_camera(Hints(), IMAGE) is None


def test_a_guessed_focal_length_depends_on_the_long_side_and_is_marked():
    for image in (IMAGE, IMAGE.swapaxes(0, 1)):
        camera, (note,) = guessed_camera(90.0, image)
        np.testing.assert_allclose([camera.fx, camera.fy], 100.0)
        assert camera.guessed
        assert note == "focal length is a default (field of view 90 degrees along the long side)"
