from __future__ import annotations

import numpy as np
import pytest

from physic_testing.worlds.rooms import Room, Walls
from physic_testing.worlds.solids import Block, Ground
from physic_testing.worlds.textures import Patch

BLOCK = Block((0.5, 0.25, 0.2), (0.3, 0.25, 0.2), yaw=0.4)
WALLS = Walls((-2, -2), (2, 3), 2.5)
ROOM = Room(Ground(), (BLOCK,), WALLS, Patch("planks", 0))
TURNED = Room(Ground(), (BLOCK,), Walls((-2, -2), (2, 3), 2.5, yaw=0.3), Patch("tiles", 0))
SLOPE = Room(
    Ground((0.0, float(np.cos(0.2)), float(np.sin(0.2))), "grass"),
    (BLOCK,),
    None,
    Patch("grass", 0),
)


def surface_samples(room: Room, count: int = 4000) -> np.ndarray:
    vertices, faces, _ = room.mesh()
    rng = np.random.default_rng(0)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    face = rng.choice(len(faces), count, p=area / area.sum())
    s, t = rng.random((2, count, 1))
    s, t = np.where(s + t > 1, 1 - s, s), np.where(s + t > 1, 1 - t, t)
    return a[face] + s * (b - a)[face] + t * (c - a)[face]


def test_distances_to_a_known_room_are_exact():
    points = np.array(
        [[-1.0, 0.3, 1.0], [0.5, 0.7, 0.2], [0.5, 0.45, 0.2], [0.0, -0.1, 0.0], [1.9, 1.0, 0.0]]
    )
    np.testing.assert_allclose(
        ROOM.signed_distance(points), [0.3, 0.2, -0.05, -0.1, 0.1], atol=1e-12
    )
    np.testing.assert_allclose(
        ROOM.signed_distance(np.array([[0, 2.4, 0], [0, 2.6, 0], [-2.2, 1, 0]])), [0.1, -0.1, -0.2]
    )


@pytest.mark.parametrize("room", [ROOM, TURNED, SLOPE], ids=["room", "move_plan", "slope"])
def test_no_point_of_the_mesh_is_outside_its_own_solid(room):
    distance = room.signed_distance(surface_samples(room))
    assert distance.max() < 1e-10
    assert np.median(np.abs(distance)) < 1e-10


@pytest.mark.parametrize("room", [ROOM, TURNED, SLOPE], ids=["room", "move_plan", "slope"])
def test_normals_of_faces_point_into_free_space(room):
    vertices, faces, surface = room.mesh()
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    middle = (a + b + c) / 3
    buried = (surface >= 6) & (middle[:, 1] < 0.2)  # the block's bottom, and its feet in the slope
    assert (room.signed_distance(middle + 0.01 * normal)[~buried] > 0).all()
    up = normal[surface == 0]
    np.testing.assert_allclose(up, np.broadcast_to(room.ground.normal, up.shape), atol=1e-12)
