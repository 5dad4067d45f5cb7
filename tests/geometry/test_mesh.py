"""Normals and areas of vertices, of NumPy arrays and of tensors."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import trimesh
from numpy.testing import assert_allclose
from torch.testing import assert_close

from physic_core.geometry.mesh import (
    faces_around_vertices,
    faces_of_vertices,
    vertex_areas,
    vertex_normals,
)

pytestmark = pytest.mark.quick


@pytest.fixture(params=[np.asarray, torch.tensor], ids=["numpy", "torch"])
def array(request):
    return request.param


def test_normals_point_outward_weighted_by_area(array):
    # Corner of a box of 1 x 2 x 3, with a diagonal through the corner on one side only.
    vertices = array(np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]]))
    faces = array(np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2]]))
    normals = vertex_normals(vertices, faces)
    assert type(normals) is type(vertices)
    assert_allclose(np.asarray(normals[0]), np.array([-6.0, -3.0, -2.0]) / 7.0, rtol=1e-12)


def test_areas_add_up_to_the_surface(array):
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    areas = vertex_areas(array(np.array(box.vertices)), array(np.array(box.faces)))
    assert float(areas.sum()) == pytest.approx(22)


def test_a_vertex_without_a_face_has_neither_normal_nor_area(array):
    vertices = array(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [5.0, 5.0, 5.0]]))
    faces = array(np.array([[0, 1, 2]]))
    assert vertex_normals(vertices, faces)[3].tolist() == [0.0, 0.0, 0.0]
    assert vertex_areas(vertices, faces).tolist() == pytest.approx([1 / 6, 1 / 6, 1 / 6, 0.0])


def test_the_faces_around_a_vertex_give_the_same_normals():
    ball = trimesh.creation.icosphere(2, 0.3)
    vertices = torch.tensor(ball.vertices)
    faces = torch.tensor(ball.faces)
    around = faces_of_vertices(faces, len(vertices))
    of_seven = (faces == 7).any(1).nonzero().flatten().tolist()
    assert set(around[7].tolist()) - {len(faces)} == set(of_seven)
    batch = torch.stack([vertices, vertices * torch.tensor([1.0, 2.0, 0.5])])
    assert_close(vertex_normals(batch, faces, around), vertex_normals(batch, faces))
    assert_close(vertex_normals(batch, faces, around[3:5]), vertex_normals(batch, faces)[:, 3:5])
    some = vertex_normals(batch, *faces_around_vertices(faces, around[3:5]))
    assert torch.equal(some, vertex_normals(batch, faces, around[3:5]))
