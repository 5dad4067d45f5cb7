"""Selection of pixels, tests of points and medians equal those by masks, reductions and NumPy."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_core.geometry.pixels import all_finite, median

pytestmark = pytest.mark.quick


def test_a_point_is_finite_with_all_of_its_coordinates():
    points = torch.tensor(
        [[1.0, -2.0, 3.0], [torch.nan, 0, 0], [0, torch.inf, -torch.inf], [0, 0, -torch.inf]]
    )
    assert all_finite(points).tolist() == [True, False, False, False]


@pytest.mark.parametrize("count", [1, 4, 7])
def test_the_median_is_the_mean_of_the_two_middle_values(count):
    values = np.random.default_rng(0).normal(size=(count, 3))
    assert median(torch.from_numpy(values)).tolist() == np.median(values, axis=0).tolist()
