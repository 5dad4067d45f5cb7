"""The grid of nearest points: true distances to nearly the nearest point."""

from __future__ import annotations

import torch

from physic_core.geometry.neighbors import NearestPointSearch
from physic_paper.grid_search import GridSearch


def room(count=20_000):
    """Points of a floor and a wall, with their normals."""
    g = torch.Generator().manual_seed(0)
    floor = torch.rand(count // 2, 3, generator=g) * torch.tensor([4.0, 0.0, 4.0]) + torch.tensor(
        [-2.0, 1.2, 2.0]
    )
    wall = torch.rand(count // 2, 3, generator=g) * torch.tensor([4.0, 3.0, 0.0]) + torch.tensor(
        [-2.0, -1.8, 6.0]
    )
    up = torch.tensor([0.0, -1.0, 0.0])
    back = torch.tensor([0.0, 0.0, -1.0])
    return torch.cat([floor, wall]), torch.cat(
        [up.expand(count // 2, 3), back.expand(count // 2, 3)]
    )


def vertices(count=500):
    box = torch.rand(2, count, 3, generator=torch.Generator().manual_seed(1)) * torch.tensor(
        [1.0, 1.8, 1.0]
    )
    return box + torch.tensor([-0.5, -0.5, 5.0])


def test_distances_are_true_and_to_nearly_the_nearest_point():
    got = GridSearch(*room(), radius=0.15).query(vertices())
    want = NearestPointSearch(*room(), radius=0.15).query(vertices())
    both = got.is_found & want.is_found
    excess = (got.distance - want.distance)[both]
    assert excess.min() > -1e-6
    assert excess.mean() < 0.012
    assert excess.max() < 0.06
    assert (got.is_found == want.is_found).float().mean() > 0.95


def test_a_vertex_outside_the_box_changes_nothing_for_the_others():
    grid = GridSearch(*room(), radius=0.15)
    inside = vertices()[0, :10]
    with_stray = torch.cat([inside, torch.tensor([[100.0, 0.0, 0.0]])])
    alone = grid.query(inside)
    both = grid.query(with_stray)
    assert torch.equal(both.distance[:-1], alone.distance)
    assert not both.is_found[-1]


def test_nothing_is_near_an_empty_scene_and_no_number_is_near_nothing():
    empty = GridSearch(torch.zeros(0, 3), torch.zeros(0, 3), radius=0.15).query(vertices())
    assert not empty.is_found.any()
    broken = vertices()[0, :4].clone()
    broken[1, 2] = float("nan")
    grid = GridSearch(*room(1000), radius=10.0)
    assert grid.query(broken).is_found.tolist() == [True, False, True, True]
    assert grid.query(torch.zeros(0, 3)).index.shape == (0,)


def test_the_radius_is_in_metres_of_the_scaled_scene():
    scene = GridSearch(torch.tensor([[0.0, 0.0, 2.0]]), torch.zeros(1, 3), radius=0.15, cells=16)
    for scale in (1.0, 2.0):
        query = scene.query(
            torch.tensor([[0.0, 0.14, 2.0 * scale], [0.0, 0.16, 2.0 * scale]]), scale=scale
        )
        assert query.is_found.tolist() == [True, False]
        torch.testing.assert_close(query.distance, torch.tensor([0.14, torch.inf]))
