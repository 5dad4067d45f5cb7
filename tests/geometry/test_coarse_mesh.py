"""A coarse mesh: who stands for whom, and that it hides what the fine one hides."""

from __future__ import annotations

import pytest
import torch
import trimesh

from physic_core.body import load_body
from physic_core.geometry.mesh import coarse_mesh
from physic_core.geometry.rotvecs import rotvec_to_rotmat
from physic_core.geometry.visibility import self_occlusion

pytestmark = pytest.mark.quick


def test_a_sphere_keeps_its_surface_and_its_outside():
    ball = trimesh.creation.icosphere(5, 1.0)
    vertices = torch.from_numpy(ball.vertices.copy())
    faces = torch.from_numpy(ball.faces.copy())
    coarse = coarse_mesh(vertices, faces, torch.zeros(len(vertices), dtype=torch.int64), 0.15)
    assert len(coarse.ids) < len(vertices) / 8
    few = trimesh.Trimesh(vertices[coarse.ids], coarse.faces, process=False)
    assert few.is_watertight
    assert few.volume == pytest.approx(ball.volume, rel=0.02)


def test_it_hides_the_limbs_that_the_whole_mesh_hides():
    model = load_body("embedded")
    generator = torch.Generator().manual_seed(3)
    turns = 0.5 * torch.randn(12, 55, 3, generator=generator)
    turns[:, 0] = 2 * torch.randn(12, 3, generator=generator)
    places = torch.tensor([0.0, 0.0, 3.5]).expand(12, 3)
    bodies = model(rotvec_to_rotmat(turns), torch.zeros(12, model.num_betas), places).vertices
    every = range(len(model.part_names))
    fine, coarse = (
        self_occlusion(bodies, model.faces, model.part_of_vertex, every, 0.3, mesh)[1]
        for mesh in (None, model.coarse)
    )
    of_parts = [int((model.part_of_vertex == part).nonzero()[0]) for part in every]
    assert len(model.coarse.ids) < 0.3 * model.num_vertices
    assert (fine != coarse)[:, of_parts].float().mean().item() < 0.03
