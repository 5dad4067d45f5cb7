"""Points inside a body, or before one that the photo shows, move behind it along their rays; all
others stay.
"""

from __future__ import annotations

import pytest
import torch
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.testing import assert_close

from physic_core.geometry.visibility import move_out_of_bodies

pytestmark = pytest.mark.quick

RADIUS = 0.25
_BALL = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS)
FACES = torch.from_numpy(_BALL.faces.copy()).long()


def ball(*centre):
    return torch.from_numpy(_BALL.vertices.copy()) + torch.tensor(centre, dtype=torch.float64)


CENTRE = torch.tensor([0.1, 0.0, 3.0], dtype=torch.float64)
BODY = ball(*CENTRE.tolist())[None]


def nowhere(points, bodies=1):
    return torch.zeros((bodies, len(points)), dtype=torch.bool)


def points(seed, count=400):
    """Round a ball at (0.1, 0, 3), within and without."""
    generator = torch.Generator().manual_seed(seed)
    spread = 2 * torch.rand(count, 3, generator=generator, dtype=torch.float64) - 1
    return CENTRE + 0.4 * spread


@given(st.integers(0, 1000))
@settings(max_examples=5, deadline=None)
def test_points_inside_a_body_move_behind_it_along_the_ray_and_the_rest_stays(seed):
    before = points(seed)
    after, moved = move_out_of_bodies(before, BODY, FACES, nowhere(before), 1.0)
    off = (before - CENTRE).norm(dim=-1)
    sure = (off - RADIUS).abs() > 1e-3  # the mesh is a millimetre off the ball
    assert torch.equal(moved[sure], (off < RADIUS)[sure])
    assert torch.equal(after[~moved], before[~moved])
    assert ((after[moved] - CENTRE).norm(dim=-1) - RADIUS).abs().max() < 1.5e-3
    farther = after[moved].norm(dim=-1) / before[moved].norm(dim=-1)
    assert (farther > 1).all()
    assert_close(after[moved], before[moved] * farther[:, None])


def test_out_of_one_body_and_into_the_next_is_out_of_both():
    both = torch.stack([ball(0.0, 0.0, 3.3), ball(0.0, 0.0, 3.0)])
    inside = torch.tensor([[0.0, 0.0, 2.9]], dtype=torch.float64)
    after, moved = move_out_of_bodies(inside, both, FACES, nowhere(inside, 2), 1.0)
    assert moved.all()
    assert after[0, 2].item() == pytest.approx(3.3 + RADIUS, abs=2e-3)


def test_what_hides_a_body_that_the_photo_shows_moves_behind_it():
    rays = (points(1) - torch.tensor([0.0, 0.0, 0.1])) / 3.0
    before = rays * 2.2
    shown = torch.arange(400) % 2 == 0
    nearest = rays * (rays @ CENTRE / rays.square().sum(-1))[:, None]
    off = (nearest - CENTRE).norm(dim=-1)
    sure = (off - RADIUS).abs() > 5e-3  # at the rim a ray may miss the mesh
    after, moved = move_out_of_bodies(before, BODY, FACES, shown[None], 2.0)
    assert torch.equal(moved[sure], ((off < RADIUS) & shown)[sure])
    assert torch.equal(after[~moved], before[~moved])
    assert ((after[moved] - CENTRE).norm(dim=-1) - RADIUS).abs().max() < 5e-3
    assert (after[moved].norm(dim=-1) > nearest[moved].norm(dim=-1)).all()
