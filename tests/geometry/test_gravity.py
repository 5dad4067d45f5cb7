"""Up from surface normals: found for any camera in a room; not where the surfaces leave it open."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from torch.nn.functional import normalize

from physic_core.engine.up import angle_deg
from physic_core.geometry.plane import estimate_up

pytestmark = pytest.mark.quick


def camera(pitch_deg, roll_deg=0.0):
    """(3, 3), turns room axes (x right, y down, z forward) into those of a camera that looks down
    and is rolled.
    """
    turn = Rotation.from_euler("xz", [pitch_deg, roll_deg], degrees=True)
    return torch.from_numpy(turn.as_matrix())


def up(pitch_deg, roll_deg=0.0):
    return camera(pitch_deg, roll_deg) @ torch.tensor([0.0, -1.0, 0.0], dtype=torch.float64)


def surfaces(
    turned,
    floor=2000,
    ceiling=600,
    facing=1500,
    side=1200,
    clutter=1200,
    noise_deg=4.0,
    seed=0,
):
    """(M, 3) normals of as many pixels of floor, ceiling, two walls that stand askew and clutter,
    camera frame.
    """
    generator = torch.Generator().manual_seed(seed)
    askew = math.radians(20.0)
    directions = [
        ([0.0, -1.0, 0.0], floor),
        ([0.0, 1.0, 0.0], ceiling),
        ([math.sin(askew), 0.0, -math.cos(askew)], facing),
        ([math.cos(askew), 0.0, math.sin(askew)], side),
    ]
    flat = torch.cat([torch.tensor(d, dtype=torch.float64).expand(n, 3) for d, n in directions])
    flat = flat + math.radians(noise_deg) * torch.randn(
        flat.shape, dtype=torch.float64, generator=generator
    )
    random = torch.randn(clutter, 3, dtype=torch.float64, generator=generator)
    return normalize(torch.cat([flat, random]) @ turned.T, dim=-1)


@given(st.floats(-10, 35), st.floats(-15, 15), st.integers(0, 1000))
@settings(max_examples=30, deadline=None)
def test_up_is_found_for_any_camera_held_by_hand(pitch, roll, seed):
    estimate = estimate_up(surfaces(camera(pitch, roll), seed=seed))
    assert angle_deg(estimate.up, up(pitch, roll)) < 1.0
    assert estimate.up.dtype == torch.float64
    assert float(torch.linalg.vector_norm(estimate.up)) == pytest.approx(1.0)
    assert 0 < estimate.confidence < 1


FLOOR_ALONE = {"ceiling": 0, "facing": 0, "side": 0}


@pytest.mark.parametrize("lacking", [FLOOR_ALONE, {"floor": 0, "ceiling": 0}])
def test_up_is_found_from_the_floor_or_walls_alone(lacking):
    estimate = estimate_up(surfaces(camera(20.0, -10.0), clutter=0, **lacking))
    assert angle_deg(estimate.up, up(20.0, -10.0)) < 0.5
    assert estimate.confidence > 0.2


def test_one_wall_with_hardly_anything_level_is_far_less_firm_than_a_room():
    room = estimate_up(surfaces(camera(10.0)))
    wall = estimate_up(surfaces(camera(10.0), floor=60, ceiling=0, facing=5000, side=0))
    assert wall.confidence < 0.25 * room.confidence


def test_a_single_frontal_wall_gives_an_up_direction_without_confidence():
    estimate = estimate_up(torch.tensor([[0.0, 0.0, -1.0]]).expand(1000, 3))
    assert float(torch.linalg.vector_norm(estimate.up)) == pytest.approx(1.0)
    assert estimate.confidence == 0.0
