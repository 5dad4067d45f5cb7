"""Distances to the floor, where its plane and points of the scene measure it."""

from __future__ import annotations

import torch

from physic_core.engine.contact.distance import SurfaceDistances
from physic_core.engine.contact.floor_points import combine_floor_points
from physic_core.engine.contact.scene_parts import SceneParts


def combined(floor: float, scene: float, *, ground: bool = True) -> tuple[float, float]:
    """Return the distances of one vertex to floor and scene, whose nearest point is of the floor or not."""
    near = SurfaceDistances(
        scene=torch.tensor([[scene]]), floor=torch.tensor([[floor]]), point=torch.zeros(1, 1, dtype=torch.int64)
    )
    zero = torch.zeros(1, dtype=torch.int64)
    found = combine_floor_points(near, SceneParts(("floor",), zero, zero, torch.tensor([ground])))
    return round(float(found.floor), 6), round(float(found.scene), 6)


def test_a_point_of_the_floor_moves_the_distance_to_the_plane_by_a_third_of_its_difference():
    assert combined(0.03, 0.01) == (0.023, torch.inf)
    assert combined(0.0, 0.02) == (0.007, torch.inf)


def test_a_point_far_from_the_plane_moves_it_by_less_than_a_centimetre():
    assert combined(0.1, 0.0) == (0.09125, torch.inf)


def test_other_points_and_points_far_from_the_plane_keep_their_distances():
    assert combined(0.03, 0.01, ground=False) == (0.03, 0.01)
    assert combined(torch.inf, 0.01) == (torch.inf, 0.01)
    assert combined(0.03, torch.inf) == (0.03, torch.inf)
