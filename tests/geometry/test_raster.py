"""The rasteriser against hand-drawn triangles, and against one ray a vertex."""

from __future__ import annotations

import pytest
import roma
import torch

from physic_core.body import load_body
from physic_core.geometry.raster import hidden_by_raster, rasterize
from physic_core.geometry.visibility import hidden_from_camera


def test_a_triangle_covers_the_pixels_inside_it():
    # Seen from its front, counter-clockwise with x to the right and y down runs the other way round.
    pixels = torch.tensor([[[0.0, 0.0], [0.0, 4.0], [4.0, 0.0]]])
    z = torch.ones(1, 3)
    got = rasterize(pixels, z, torch.tensor([[0, 1, 2]]), 5, 6)
    want = [[0 if x + y <= 4 else -1 for x in range(6)] for y in range(5)]
    assert got[0].tolist() == want
    away = rasterize(pixels, z, torch.tensor([[0, 2, 1]]), 5, 6)
    assert (away == -1).all()


def test_the_nearer_of_two_wins_pixel_by_pixel():
    """A level triangle at 2 m, and one that leans through it: 1 / z is what is linear in the picture."""
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


@pytest.fixture(scope="module")
def bodies():
    """Four embedded bodies in random poses, turned at random, 2 to 5 m away; their mesh and its parts."""
    model = load_body("embedded")
    g = torch.Generator().manual_seed(0)
    turns = 0.4 * torch.randn(4, 55, 3, generator=g)
    turns[:, 0] = 2 * torch.randn(4, 3, generator=g)
    transl = torch.tensor([[0.0, 0.0, 2.0], [0.5, 0.2, 3.0], [-0.7, 0.3, 4.0], [0.0, 1.0, 5.0]])
    posed = model(roma.rotvec_to_rotmat(turns), torch.randn(4, model.num_betas, generator=g), transl)
    return posed.vertices, model


def part_shares(hidden, face, model):
    """(B, P) share of each part that another part hides."""
    part = model.part_of_vertex
    other = hidden & (part[model.faces[face.clamp(min=0), 0]] != part)
    count = len(model.part_names)
    lost = torch.zeros(len(hidden), count).index_add(1, part, other.float())
    return lost / torch.bincount(part, minlength=count)


def test_vertices_hidden_by_raster_are_those_hidden_by_rays(bodies):
    """All but 3 % of the vertices, most of them fingers and face, and within 0.02 what is hidden of each part."""
    vertices, model = bodies[0][:2], bodies[1]
    by_ray, by_pixel = hidden_from_camera(vertices, model.faces), hidden_by_raster(vertices, model.faces)
    different = (by_ray[0] != by_pixel[0]).float().mean(1)
    apart = (part_shares(*by_ray, model) - part_shares(*by_pixel, model)).abs()
    assert different.max() < 0.03
    assert apart.max() < 0.02


def test_a_batch_is_its_bodies_one_by_one_bit_for_bit(bodies):
    vertices, model = bodies
    together = hidden_by_raster(vertices, model.faces, 256)
    alone = [hidden_by_raster(body[None], model.faces, 256) for body in vertices]
    for k in range(2):
        assert torch.equal(together[k], torch.cat([pair[k] for pair in alone]))


def test_a_person_behind_the_camera_hides_nothing(bodies):
    vertices, model = bodies
    behind = vertices[:1] * torch.tensor([1.0, 1.0, -1.0])
    hidden, face = hidden_by_raster(behind, model.faces, 64)
    assert not hidden.any()
    assert (face == -1).all()


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_cuda_draws_the_same_pixels_as_the_cpu(bodies):
    vertices, model = bodies
    want, _ = hidden_by_raster(vertices, model.faces)
    got, _ = hidden_from_camera(vertices.cuda(), model.faces.cuda())
    assert (got.cpu() != want).float().mean() < 1e-3
