"""A small reconstruction for tests of what is around it."""

from __future__ import annotations

import numpy as np

from physic_core.types import Intrinsics, Reconstruction, Scene


def empty_reconstruction(**entries):
    """A flat scene without people, 64 x 64 px, 1 m away."""
    points = np.ones((64, 64, 3), np.float32)
    camera = Intrinsics(64, 64, 31.5, 31.5, 64, 64)
    colors = np.zeros((64, 64, 3), np.uint8)
    valid = np.ones((64, 64), bool)
    scene = Scene(points, np.zeros_like(points), colors, valid, None, np.zeros((0, 3), np.float32))
    return Reconstruction(
        colors, camera, scene, (), np.zeros((0, 3), np.int32), "embedded", "coco17", **entries
    )
