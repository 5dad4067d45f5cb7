"""The embedded metric depth is the relative depth at the scale that the hints state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_core.errors import BackendError
from physic_core.types import Hints, Intrinsics, Pointmap, SceneScale
from physic_embedded.metric_depth import EmbeddedMetricDepth

CAMERA = Intrinsics.from_focal(150.0, 3, 2)
IMAGE = np.zeros((2, 3, 3), np.uint8)


def hints(shift=0.0):
    points = np.ones((2, 3, 3), np.float32)
    points[..., 2] = [[1.0, 2.0, 4.0], [1.0, 2.0, -1.0]]
    scene = Pointmap(points, points[..., 2] > 0, "inverse_scale_shift", CAMERA)
    return Hints(scene=scene, scale=SceneScale(3.0, shift, 0.1, ("a note",)))


@pytest.mark.parametrize(
    ("shift", "expected"),
    [(0.0, [3.0, 6.0, 12.0]), (0.25, [2.4, 4.0, 6.0]), (-0.25, [4.0, 12.0, np.nan])],
    ids=["no shift", "farther points moved more", "the farthest at infinity"],
)
def test_the_depth_is_that_of_the_scene_at_its_scale_and_shift(shift, expected):
    answer = EmbeddedMetricDepth().infer(IMAGE, hints(shift))
    assert answer.depth[0].tolist() == pytest.approx(expected, nan_ok=True)
    assert np.isnan(answer.depth[1, 2])
    assert (answer.intrinsics, answer.scale_sigma, answer.notes) == (CAMERA, 0.1, ("a note",))


@pytest.mark.parametrize("missing", ["scene", "scale"])
def test_without_a_scene_or_its_scale_it_says_what_is_missing(missing):
    with pytest.raises(BackendError, match=f"hints.{missing} is missing"):
        EmbeddedMetricDepth().infer(IMAGE, replace(hints(), **{missing: None}))
