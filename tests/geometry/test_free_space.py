"""What lies before a depth map is in the open, though the nearest point's normal says it is
inside.
"""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from physic_core.geometry.visibility import front_depth, in_free_space
from physic_core.types import Intrinsics
from physic_testing.metrics import hidden_by_depth_map

pytestmark = pytest.mark.quick

CAMERA = Intrinsics(40.0, 42.0, 15.5, 11.5, 32, 24)
K = torch.from_numpy(CAMERA.matrix)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_free_space_equals_the_visibility_of_the_benchmark(seed):
    draw = np.random.default_rng(seed)
    depth = draw.uniform(1.0, 4.0, (24, 32))
    depth[draw.random((24, 32)) < 0.2] = np.nan
    points = draw.normal([0.0, 0.0, 2.5], [1.5, 1.2, 1.5], (300, 3))
    free = in_free_space(torch.from_numpy(points), front_depth(torch.from_numpy(depth)), K)
    assert_array_equal(~free.numpy(), hidden_by_depth_map(points, depth, CAMERA, tolerance=0.0))


def test_nothing_is_known_outside_the_picture_and_behind_the_camera():
    wall = front_depth(torch.ones(24, 32))
    points = torch.tensor([[0.0, 0.0, 2.0], [5.0, 0.0, 2.0], [0.0, -5.0, 2.0], [0.0, 0.0, -2.0]])
    assert in_free_space(points, wall, K).tolist() == [False, True, True, True]
    assert in_free_space(points, front_depth(torch.full((24, 32), torch.nan)), K).all()
