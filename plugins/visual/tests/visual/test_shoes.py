"""Shoes, for display: toes under one cap, unless the photo shows bare feet."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import ConvexHull

from physic_core.body import load_body
from physic_core.body.joints import JOINT_INDEX
from physic_core.geometry.mesh import vertex_normals
from physic_visual.textures.shoes import with_shoes


def test_a_shoe_is_the_hull_of_the_toes_and_stands_where_they_stood():
    model = load_body("embedded")
    vertices = model.skin.template.T.double().numpy()
    faces = model.faces.numpy()
    weight = model.skin.weights[JOINT_INDEX["left_foot"]].double().numpy()
    shod, normals = with_shoes(vertices, vertex_normals(vertices, faces), [weight])
    assert_array_equal(shod[weight == 0], vertices[weight == 0])
    toes = weight == 1
    hull = ConvexHull(vertices[weight > 0])
    inside, before = (
        -(body[toes] @ hull.equations[:, :3].T + hull.equations[:, 3]).max(1)
        for body in (shod, vertices)
    )
    assert_allclose(inside, 0, atol=1e-6)
    assert before.max() > 0.005  # between the toes
    for extreme in (np.min, np.max):
        assert_allclose(extreme(shod, 0), extreme(vertices, 0), atol=1e-6)
    assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
