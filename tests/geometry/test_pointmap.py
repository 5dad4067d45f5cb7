"""Point maps: exact normals, edges, outliers and cameras against slow twins and known answers."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch.nn.functional import normalize
from torch.testing import assert_close

from physic_core.geometry.camera import intrinsics_matrix, pixel_grid, pixel_rays, project
from physic_core.geometry.pointmap import (
    depth_to_pointmap,
    intrinsics_from_pointmap,
    pointmap_normals,
)

pytestmark = pytest.mark.quick

ROWS = 48
COLUMNS = 64
ALL = torch.ones((ROWS, COLUMNS), dtype=torch.bool)
K = intrinsics_matrix(
    60.0, 62.0, (COLUMNS - 1) / 2, (ROWS - 1) / 2, torch.zeros((), dtype=torch.float64)
)
RAYS = pixel_rays(ROWS, COLUMNS, K)


AHEAD = torch.tensor([0.0, 0.0, -1.0], dtype=torch.float64)


def random(*shape, seed=0):
    return torch.rand(*shape, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


def plane_depth(normal, offset):
    """Depth (H, W) at which each ray meets n . X + o = 0."""
    return -offset / (RAYS @ normal)


def test_every_point_projects_onto_its_own_pixel():
    points = depth_to_pointmap(1 + 5 * random(ROWS, COLUMNS), K)
    assert_close(project(points, K), pixel_grid(ROWS, COLUMNS, points))


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(1e-6, 1e6))
def test_a_plane_has_its_exact_normal_up_to_the_border_in_any_unit(x, y, unit):
    normal = normalize(AHEAD + torch.tensor([x, y, 0.0]), dim=0)
    points = depth_to_pointmap(plane_depth(normal, unit), K)
    found = pointmap_normals(points, ALL)
    assert_close(found, normal.expand(ROWS, COLUMNS, 3), atol=1e-6, rtol=0)


def test_normals_of_float32_points_are_right_to_the_last_digit():
    # Then all CPUs agree about them, whatever the order of their sums.
    points = depth_to_pointmap(1 + random(ROWS, COLUMNS), K).float()
    found = pointmap_normals(points, ALL)
    assert found.dtype == torch.float32
    assert torch.equal(found, pointmap_normals(points.double(), ALL).float())


def test_beside_a_depth_edge_each_surface_keeps_its_own_normal():
    left = normalize(AHEAD + torch.tensor([0.3, 0.0, 0.0]), dim=0)
    depth = plane_depth(left, 1.0)
    depth[:, 32:] = 4.0
    found = pointmap_normals(depth_to_pointmap(depth, K), ALL)
    assert_close(found[:, :32], left.expand(ROWS, 32, 3))
    assert_close(found[:, 32:], AHEAD.expand(ROWS, 32, 3))


def test_a_point_that_floats_between_two_surfaces_has_no_normal():
    depth = torch.full((ROWS, COLUMNS), 2.0, dtype=torch.float64)
    depth[:, 32:] = 4.0
    depth[:, 32] = 3.0
    found = pointmap_normals(depth_to_pointmap(depth, K), ALL)
    assert (found[:, 32] == 0).all()
    assert (torch.linalg.vector_norm(found[:, 31], dim=-1) - 1).abs().max() < 1e-12


def test_invalid_pixels_neither_get_a_normal_nor_spoil_a_neighbours():
    depth = torch.full((ROWS, COLUMNS), 2.0, dtype=torch.float64)
    depth[10, 10] = math.nan
    valid = ALL.clone()
    valid[10, 10] = False
    found = pointmap_normals(depth_to_pointmap(depth, K), valid)
    assert (found[10, 10] == 0).all()
    expected = AHEAD.repeat(3, 3, 1)
    expected[1, 1] = 0
    assert_close(found[9:12, 9:12], expected)


def test_the_camera_of_a_point_map_is_recovered_among_outliers():
    points = depth_to_pointmap(1 + 5 * random(ROWS, COLUMNS), K)
    bad = random(ROWS, COLUMNS, seed=1) < 0.3
    points = torch.where(bad[..., None], points + random(ROWS, COLUMNS, 3, seed=2) - 0.5, points)
    fx, fy, cx, cy = intrinsics_from_pointmap(points, ALL)
    assert fx == pytest.approx(60, rel=0.005)
    assert fy == pytest.approx(62, rel=0.005)
    assert (cx, cy) == (31.5, 23.5)
