"""Shoes, for display: toes under one cap, unless the photo shows bare feet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import ConvexHull

from physic_core.body import load_body
from physic_core.body.joints import JOINT_INDEX
from physic_core.geometry.mesh import vertex_normals
from physic_visual.textures.dressed import dressed_bodies
from physic_visual.textures.shoes import with_shoes

SKIN = [222, 175, 150]
DARK_SKIN = [120, 80, 62]
BLACK = [25, 25, 28]
GREY = [150, 150, 150]
RED = [200, 30, 40]


def with_legs_of_colour(result, color):
    image = result.image.copy()
    for person in result.people:
        image[person.mask] = SKIN
        rows, columns = np.nonzero(person.mask)
        legs = rows > np.median(rows)
        image[rows[legs], columns[legs]] = color
    return replace(result, image=image)


@pytest.mark.parametrize(
    ("color", "shod"), [(SKIN, 0), (DARK_SKIN, 0), (BLACK, 2), (GREY, 2), (RED, 2)]
)
def test_feet_have_shoes_unless_they_have_the_colour_of_skin(result, color, shod):
    dressed = dressed_bodies(with_legs_of_colour(result, color))
    for index, person in enumerate(result.people):
        body = dressed.people[index]
        assert len(body.shoes) == shod
        assert (body.vertices != person.vertices).any() == bool(shod)


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
