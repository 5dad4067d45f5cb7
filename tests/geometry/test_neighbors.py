"""Nearest scene points: the tree against all distances, bounded, under a scene scale."""

from __future__ import annotations

import pytest
import torch
from torch.testing import assert_close

from physic_core.geometry.neighbors import NearestPointSearch, inside_body_boxes

pytestmark = pytest.mark.quick


def room(count=20_000, seed=0):
    """Points of a floor and a wall, with their normals."""
    g = torch.Generator().manual_seed(seed)
    size = torch.tensor([[4.0, 0.0, 4.0], [4.0, 3.0, 0.0]])
    corner = torch.tensor([[-2.0, 1.2, 2.0], [-2.0, -1.8, 6.0]])
    points = torch.rand(count // 2, 2, 3, generator=g) * size + corner
    normals = torch.tensor([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]).expand_as(points)
    return points.reshape(-1, 3), normals.reshape(-1, 3)


def vertices(count=500, seed=1):
    g = torch.Generator().manual_seed(seed)
    box = torch.rand(2, count, 3, generator=g) * torch.tensor([1.0, 1.8, 1.0])
    return box + torch.tensor([-0.5, -0.5, 5.0])


@pytest.mark.parametrize("scale", [1.0, 0.8, 1.3])
def test_tree_equals_plain_search(scale):
    points, normals = room()
    query = vertices() * scale
    got = NearestPointSearch(points, normals).query(query, scale)
    every = torch.cdist(
        query.double(), scale * points.double(), compute_mode="donot_use_mm_for_euclid_dist"
    ).amin(-1)
    assert got.is_found.any()
    assert not got.is_found.all()
    assert torch.equal(got.is_found, every < 0.15)
    assert torch.isinf(got.distance[~got.is_found]).all()
    assert_close(got.distance[got.is_found].double(), every[got.is_found], atol=1e-6, rtol=0)
    near = points[got.index] * scale - query
    assert_close(near.norm(dim=-1)[got.is_found], got.distance[got.is_found], atol=1e-6, rtol=0)


def test_a_vertex_that_is_not_a_number_is_near_nothing():
    points, normals = room(1000)
    broken = vertices()[0, :4].clone()
    broken[1, 2] = float("nan")
    query = NearestPointSearch(points, normals, radius=10.0).query(broken)
    assert query.is_found.tolist() == [True, False, True, True]


def test_points_in_the_enlarged_box_of_any_body_are_in_it():
    bodies = torch.tensor([[[0.0, 0, 2], [1, 1, 3]], [[5.0, 0, 2], [6, 1, 3]]])
    middle = torch.tensor([0.5, 0.5, 2.5])
    steps = torch.cat([d * torch.eye(3) for d in (0.55, -0.55, 0.65, -0.65)])
    for points in (middle + steps, middle + torch.tensor([5.0, 0, 0]) + steps):
        assert inside_body_boxes(points, bodies, 0.1).tolist() == 6 * [True] + 6 * [False]
