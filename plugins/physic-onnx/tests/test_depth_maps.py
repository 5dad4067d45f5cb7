"""Depth networks: input sizes, checked maps, and disparity to points."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physic_core.errors import BackendError
from physic_core.types import Intrinsics
from physic_onnx.depth_maps import (
    clip_disparity,
    input_size_least_scaling,
    limit_patches,
    points_from_disparity,
    squeeze_map,
)


def test_the_inverse_is_the_depth_in_units_of_the_median_distance():
    depth = np.linspace(1.0, 5.0, 35).reshape(5, 7).astype(np.float32)
    camera = Intrinsics.from_focal(8.0, 7, 5)
    points, valid = points_from_disparity(*clip_disparity(1 / depth), camera)
    assert valid.all()
    np.testing.assert_allclose(points[..., 2], depth / 3.0, rtol=1e-6)
    np.testing.assert_allclose(
        points[..., 0], points[..., 2] * ((np.arange(7) - 3.0) / 8.0), atol=1e-7
    )
    np.testing.assert_allclose(
        points[..., 1], points[..., 2] * ((np.arange(5) - 2.0) / 8.0)[:, None], atol=1e-7
    )


SIDES = st.integers(14, 4000)


@given(SIDES, SIDES, st.integers(16, 6000))
def test_a_limit_of_patches_reduces_and_never_enlarges(height, width, most):
    rows, columns = input_size_least_scaling(height, width, 518)
    less = limit_patches(rows, columns, most)
    assert less[0] % 14 == less[1] % 14 == 0
    assert less[0] <= rows
    assert less[1] <= columns
    # A strip of one patch cannot become thinner.
    assert (less[0] // 14) * (less[1] // 14) <= most or 14 in less


class TestMaps:
    @pytest.mark.parametrize(
        ("values", "words"),
        [
            (np.zeros((2, 3, 4)), r"depth of shape \(2, 3, 4\): one map"),
            (np.full((2, 3), 0.9741), r"depth = 0\.9741 for every pixel"),
        ],
    )
    def test_a_constant_map_is_refused(self, values, words):
        with pytest.raises(BackendError, match=words):
            squeeze_map(values, "depth", "file")
