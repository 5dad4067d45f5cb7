"""Selection of pixels and tests of points equal those by masks and reductions."""

from __future__ import annotations

import pytest
import torch

from physic_core.geometry.tensors import all_finite, select_pixels

pytestmark = pytest.mark.quick


def test_selected_pixels_are_those_of_the_mask():
    g = torch.Generator().manual_seed(0)
    points = torch.randn(5, 7, 3, generator=g)
    flags = torch.rand(5, 7, generator=g) < 0.5
    for mask in (torch.rand(5, 7, generator=g) < 0.4, torch.zeros(5, 7, dtype=torch.bool)):
        of_points, of_flags = select_pixels(mask, points, flags)
        assert torch.equal(of_points, points[mask])
        assert torch.equal(of_flags, flags[mask])


def test_a_point_is_finite_with_all_of_its_coordinates():
    points = torch.tensor(
        [[1.0, -2.0, 3.0], [torch.nan, 0, 0], [0, torch.inf, -torch.inf], [0, 0, -torch.inf]]
    )
    assert all_finite(points).tolist() == [True, False, False, False]
