"""Ray casts by Embree and by NumPy."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import torch
import trimesh
from numpy.testing import assert_allclose

from physic_core.body import load_body
from physic_core.geometry.rays import RayCaster
from physic_core.geometry.rotvecs import rotvec_to_rotmat

pytestmark = pytest.mark.quick

LIBRARIES = ["embree", "numpy"]


def both(vertices, faces):
    pytest.importorskip("embreex")
    return [RayCaster(vertices, faces, library) for library in LIBRARIES]


def posed_body():
    model = load_body("embedded")
    turns = 0.4 * torch.randn(1, 55, 3, generator=torch.Generator().manual_seed(0))
    turns[:, 0] = 0
    _, betas, _ = model.zero_pose()
    posed = model(rotvec_to_rotmat(turns), betas, torch.tensor([[0.1, 0.2, 3.0]]))
    return posed.vertices[0].double().numpy(), model.faces.numpy()


MESHES = {
    "body": posed_body,
    "far": lambda: (
        1e4 * (ball := trimesh.creation.icosphere(3)).vertices + np.array([0, 0, 3e4]),
        ball.faces,
    ),
}


@pytest.mark.parametrize("name", MESHES)
def test_numpy_finds_the_faces_and_distances_of_embree(name):
    vertices, faces = MESHES[name]()
    rng = np.random.default_rng(1)
    target = vertices.mean(0) + rng.normal(size=(4000, 3)) * vertices.std(0)
    origins = np.where(
        rng.random((4000, 1)) < 0.5,
        0.0,
        vertices.mean(0) + rng.normal(size=(4000, 3)) * np.ptp(vertices),
    )
    directions = (target - origins) * rng.uniform(0.1, 10, (4000, 1))
    by_embree, by_numpy = (caster.first(origins, directions) for caster in both(vertices, faces))
    same = by_embree.face == by_numpy.face
    # The others pass an edge, where float32 and float64 choose differently.
    assert same.mean() > 0.998
    hit = same & (by_numpy.face >= 0)
    assert hit.sum() > 800
    assert_allclose(by_numpy.distance[hit], by_embree.distance[hit], rtol=1e-6)
    assert_allclose(by_numpy.barycentric[hit], by_embree.barycentric[hit], atol=2e-3)
    on_face = (by_numpy.barycentric[hit][..., None] * vertices[faces[by_numpy.face[hit]]]).sum(1)
    along = origins[hit] + by_numpy.distance[hit][:, None] * directions[hit]
    assert_allclose(on_face, along, atol=1e-9 * np.abs(along).max())


def test_numpy_misses_no_ray_to_an_edge_or_a_vertex():
    ball = trimesh.creation.icosphere(4, 0.5)
    centre = np.array([0.1, 0.2, 2])
    edges = ball.vertices[np.concatenate([ball.faces[:, :2], ball.faces[:, 1:]])]
    towards = np.concatenate([ball.vertices, edges.mean(1)])
    assert (
        RayCaster(ball.vertices + centre, ball.faces, "numpy").first_faces(centre, towards) >= 0
    ).all()


def test_numpy_takes_a_mesh_without_faces_and_faces_that_are_not_finite():
    nothing = RayCaster(np.zeros((0, 3)), np.zeros((0, 3), int), "numpy")
    assert nothing.first(np.zeros(3), np.array([[0.0, 0, 1]])).face.tolist() == [-1]
    vertices = np.array(
        [[-1.0, -1, 1], [1, -1, 1], [0, 1, np.nan], [-1, -1, 2], [1, -1, 2], [0, 1, 2]]
    )
    hits = RayCaster(vertices, np.arange(6).reshape(2, 3), "numpy").first(
        np.zeros(3), np.array([[0.0, 0, 1]])
    )
    assert (hits.face.tolist(), hits.distance.tolist()) == ([1], [2])


def test_a_mesh_is_hit_where_embreex_is_not_installed():
    code = """
import sys
sys.modules["embreex"] = None
from physic_core.geometry.rays import RayCaster
caster = RayCaster([[-1, -1, 2], [1, -1, 2], [0, 1, 2]], [[0, 1, 2]])
print(caster.first([0, 0, 0], [[0, 0, 1], [5, 0, 1]]).distance.tolist())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[2.0, inf]\n"
