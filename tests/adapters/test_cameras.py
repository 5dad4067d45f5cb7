"""The camera for which a depth map is returned."""

from __future__ import annotations

import numpy as np

from physic_core.adapters.cameras import known_camera
from physic_core.types import Hints, Intrinsics

IMAGE = np.zeros((100, 200, 3), np.uint8)


def test_a_known_camera_follows_the_size_of_the_image():
    camera = known_camera(Hints(intrinsics=Intrinsics.from_focal(300.0, 400, 200)), IMAGE)
    assert (camera.fx, camera.width, camera.height) == (150.0, 200, 100)
    assert known_camera(Hints(), IMAGE) is None
