"""From disparity to points: known planes, sky, and what the median says."""

from __future__ import annotations

import numpy as np

from physic_core.types import Intrinsics
from physic_onnx.depth_maps import clip_disparity, points_from_disparity


def test_the_inverse_is_the_depth_in_units_of_the_median_distance():
    depth = np.linspace(1.0, 5.0, 35).reshape(5, 7).astype(np.float32)
    camera = Intrinsics.from_focal(8.0, 7, 5)
    points, valid = points_from_disparity(*clip_disparity(1 / depth), camera)
    assert valid.all()
    np.testing.assert_allclose(points[..., 2], depth / 3.0, rtol=1e-6)
    np.testing.assert_allclose(points[..., 0], points[..., 2] * ((np.arange(7) - 3.0) / 8.0), atol=1e-7)
    np.testing.assert_allclose(points[..., 1], points[..., 2] * ((np.arange(5) - 2.0) / 8.0)[:, None], atol=1e-7)
