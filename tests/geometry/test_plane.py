"""Planes: heights, and points sampled on them whatever their orientation."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch.nn.functional import normalize
from torch.testing import assert_close

from physic_core.geometry.floor import PlaneFit
from physic_core.geometry.plane import plane_basis, sample_plane

pytestmark = pytest.mark.quick

UP = torch.tensor([0.0, -1.0, 0.0])
NOBODY = torch.zeros(0, 3)


def cloud(count=4000, seed=0):
    """Points of a room of 6 x 3 x 8 m in front of the camera."""
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(count, 3, generator=generator) * torch.tensor([6.0, 3.0, 8.0]) - torch.tensor(
        [3.0, 1.5, -1.0]
    )


def unit(x, y, z):
    return normalize(torch.tensor([x, y, z], dtype=torch.float64), dim=0)


def test_height_is_positive_above_and_a_ray_meets_the_plane_at_its_inverse_depth():
    points = torch.tensor([[0.0, 0.0, 0.0], [3.0, 1.5, 2.0], [0.0, 2.0, 5.0]])
    plane = PlaneFit(UP, 1.5, points[:0, :0], 1.0, 0.0, "labels")
    assert plane.height(points).tolist() == [1.5, 0.0, -0.5]
    assert plane.scaled(2.0).height(points).tolist() == [3.0, 1.5, 1.0]
    assert points.new_tensor([0.0, 0.5, 1.0]) @ plane.by_ray.float() == pytest.approx(1 / 3)


directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: math.hypot(*v) > 0.1)


@given(directions)
def test_basis_is_right_handed_and_orthonormal(direction):
    normal = unit(*direction)
    first, second = plane_basis(normal)
    frame = torch.stack((first, second, normal))
    assert_close(frame @ frame.T, torch.eye(3, dtype=torch.float64))
    assert_close(torch.linalg.cross(first, second), normal)


@given(directions, st.floats(-2, 2))
def test_samples_lie_on_any_plane_and_stay_within_the_bound(direction, offset):
    normal = unit(*direction)
    points = sample_plane(normal, offset, cloud(300).double(), NOBODY.double())
    assert 0 < len(points) <= 40_000
    assert (points @ normal + offset).abs().max() < 1e-9
