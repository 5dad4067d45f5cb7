"""The pinhole camera: conventions by hand-worked numbers, and inverses."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch.testing import assert_close

from physic_core.geometry.camera import pixel_rays, project, unproject
from physic_core.types import Intrinsics

pytestmark = pytest.mark.quick

K = torch.tensor([[800.0, 0.0, 319.5], [0.0, 820.0, 239.5], [0.0, 0.0, 1.0]], dtype=torch.float64)
POINT = torch.tensor([0.5, -0.25, 2.0], dtype=torch.float64)
number = st.floats(-3.0, 3.0, allow_nan=False)


def test_projection_of_a_point_computed_by_hand():
    # 800 * 0.5 / 2 + 319.5 and 820 * -0.25 / 2 + 239.5
    assert project(POINT, K).tolist() == [519.5, 137.0]


def test_the_axis_meets_the_middle_between_the_four_central_pixels():
    camera = torch.as_tensor(Intrinsics.from_focal(500.0, 4, 2).matrix)
    assert project(camera.new_tensor([0.0, 0.0, 1.0]), camera).tolist() == [1.5, 0.5]
    rays = pixel_rays(2, 4, camera)
    assert rays.mean(dim=(0, 1)).tolist() == [0.0, 0.0, 1.0]
    assert rays[0, 0].tolist() == [-1.5 / 500, -0.5 / 500, 1.0]


def test_a_resized_camera_sees_the_same_point_on_the_same_spot_of_the_picture():
    camera = Intrinsics(800.0, 820.0, 319.5, 239.5, 640, 480)
    small = camera.resized(320, 120)
    u, v = project(POINT, torch.as_tensor(camera.matrix)).tolist()
    # Pixel edges, not centres, scale: (u + 1/2) / width is kept.
    expected = [(u + 0.5) * 0.5 - 0.5, (v + 0.5) * 0.25 - 0.5]
    assert project(POINT, torch.as_tensor(small.matrix)).tolist() == pytest.approx(expected)


@given(number, number, st.floats(0.05, 60.0))
def test_unprojected_pixels_project_back(x, y, z):
    point = torch.tensor([x, y, z], dtype=torch.float64)
    again = unproject(project(point, K), point[2], K)
    assert_close(again, point)


def test_what_is_behind_the_camera_keeps_pixel_and_gradient_finite():
    points = torch.tensor(
        [[0.1, 0.1, 0.0], [0.1, 0.1, -1.0]], dtype=torch.float64, requires_grad=True
    )
    uv = project(points, K)
    uv.sum().backward()
    assert torch.isfinite(torch.cat([uv, points.grad], 1)).all()
