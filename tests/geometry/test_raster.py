"""The rasteriser against hand-drawn triangles."""

from __future__ import annotations

import pytest
import torch

from physic_core.geometry.raster import rasterize

pytestmark = pytest.mark.quick


def test_a_triangle_covers_the_pixels_inside_it():
    # Seen from its front, counter-clockwise with x to the right and y down runs the other way
    # round.
    pixels = torch.tensor([[[0.0, 0.0], [0.0, 4.0], [4.0, 0.0]]])
    z = torch.ones(1, 3)
    got = rasterize(pixels, z, torch.tensor([[0, 1, 2]]), 5, 6)
    want = [[0 if x + y <= 4 else -1 for x in range(6)] for y in range(5)]
    assert got[0].tolist() == want
    away = rasterize(pixels, z, torch.tensor([[0, 2, 1]]), 5, 6)
    assert (away == -1).all()


def test_the_nearer_of_two_wins_pixel_by_pixel():
    """A level triangle at 2 m, and one that leans through it: 1 / z is what is linear in the
    picture.
    """
    corners = [[0.0, 0.0], [0.0, 40.0], [40.0, 0.0]]
    pixels = torch.tensor([corners + corners])
    z = torch.tensor([[2.0, 2.0, 2.0, 1.0, 1.0, 4.0]])
    got = rasterize(pixels, z, torch.tensor([[0, 1, 2], [3, 4, 5]]), 41, 41)[0, 0]
    # Along the first row 1 / z falls from 1 to 1 / 4: it passes 1 / 2 after two thirds.
    assert (got[:26] == 1).all()
    assert (got[28:] == 0).all()


@pytest.mark.parametrize("size", [3, 30, 300])
def test_triangles_of_every_size_leave_no_gap(size):
    pixels = torch.tensor([[[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]]]) * (size - 1)
    got = rasterize(pixels, torch.ones(1, 4), torch.tensor([[0, 1, 2], [0, 2, 3]]), size, size)
    assert (got >= 0).all()
