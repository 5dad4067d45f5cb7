from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from physic_core.testing.casting import Caster
from physic_core.testing.rooms import MATERIALS, Block, Room, colours

ROOM = Room((-2, 0, -2), (2, 2.5, 3), (Block((0.5, 0.25, 0.2), (0.3, 0.25, 0.2), yaw=0.4),))


def surface_samples(room: Room, count: int = 4000) -> np.ndarray:
    vertices, faces, _ = room.mesh()
    rng = np.random.default_rng(0)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    face = rng.choice(len(faces), count, p=area / area.sum())
    s, t = rng.random((2, count, 1))
    s, t = np.where(s + t > 1, 1 - s, s), np.where(s + t > 1, 1 - t, t)
    return a[face] + s * (b - a)[face] + t * (c - a)[face]


def test_distances_by_hand():
    points = np.array([[-1.0, 0.3, 1.0], [0.5, 0.7, 0.2], [0.5, 0.45, 0.2], [0.0, -0.1, 0.0], [1.9, 1.0, 0.0]])
    np.testing.assert_allclose(ROOM.signed_distance(points), [0.3, 0.2, -0.05, -0.1, 0.1], atol=1e-12)


def test_the_surface_of_the_mesh_is_at_distance_zero_or_buried():
    distance = ROOM.signed_distance(surface_samples(ROOM))
    assert distance.max() < 1e-12
    assert np.median(np.abs(distance)) < 1e-12


@given(st.tuples(st.floats(-1.9, 1.9), st.floats(0.1, 2.4), st.floats(-1.9, 2.9)))
def test_distance_in_the_air_is_that_to_the_nearest_point_of_the_surface(point):
    distance = float(ROOM.signed_distance(np.array(point)))
    nearest = np.linalg.norm(surface_samples(ROOM) - point, axis=1).min()
    if distance > 0:
        assert distance <= nearest + 1e-9
        assert nearest < distance + 0.25  # as dense as the samples lie


def test_faces_look_into_the_air():
    vertices, faces, material = ROOM.mesh()
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    middle = (a + b + c) / 3
    bottom = (material == MATERIALS.index("wood")) & (middle[:, 1] < 1e-9)
    assert (ROOM.signed_distance(middle + 0.01 * normal)[~bottom] > 0).all()
    up = normal[material == MATERIALS.index("floor")]
    np.testing.assert_allclose(up, np.broadcast_to([0, 1, 0], up.shape), atol=1e-12)


def test_every_material_has_colours_in_range():
    points = np.random.default_rng(1).uniform(-2, 2, (400, 3))
    for i in range(len(MATERIALS)):
        colour = colours(ROOM, points, np.full(len(points), i))
        assert colour.min() >= 0
        assert colour.max() <= 1
        assert colour.max() > 0.15


def test_rays_hit_a_triangle_where_it_is():
    caster = Caster(np.array([[0.0, 0, 4], [1, 0, 4], [0, 1, 4]]), np.array([[0, 1, 2]]))
    hits = caster.first(np.zeros(3), np.array([[0.25, 0.25, 4.0], [0.0625, 0.125, 1.0], [0.5, 0.5, -1.0]]))
    np.testing.assert_array_equal(hits.face, [0, 0, -1])
    np.testing.assert_allclose(hits.distance, [1, 4, np.inf], rtol=1e-6)
    np.testing.assert_allclose(hits.corners[1], [0.25, 0.25, 0.5], atol=1e-5)
    blocked = caster.blocked(np.array([0.2, 0.2, 0.0]), np.array([[0, 0, 4.1], [0, 0, 3.9], [0, 0, -9.0]]))
    np.testing.assert_array_equal(blocked, [True, False, False])
