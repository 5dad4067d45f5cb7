"""Distance of a body to a reconstructed scene: answers by hand on floors and steps, and a world's
own truth.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physic_core.types import Intrinsics, Plane
from physic_testing.metrics import (
    PROXIMITY_RADIUS_M,
    hidden_by_depth_map,
    scene_distance,
)
from physic_testing.worlds import load_world

pytestmark = pytest.mark.quick

WIDTH = 160
HEIGHT = 120
FOCAL = 80.0
CAMERA = Intrinsics.from_focal(FOCAL, WIDTH, HEIGHT)
UP = np.array([0.0, -1.0, 0.0])


def rays():
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    return np.stack([(u - CAMERA.cx) / FOCAL, (v - CAMERA.cy) / FOCAL, np.ones_like(u)], -1)


def floor_view(level=1.5, far=6.0):
    """Point map, normals and valid pixels of a level floor that lies ``level`` metres under the
    camera.
    """
    ray = rays()
    with np.errstate(divide="ignore"):
        depth = np.where(ray[..., 1] > 0, level / ray[..., 1], np.inf)
    valid = depth < far
    return (
        ray * np.where(valid, depth, 0.0)[..., None],
        np.broadcast_to(UP, ray.shape).copy(),
        valid,
    )


def wall_view(depth):
    """Point map, normals and valid pixels of fronto-parallel walls, ``depth`` (H, W) away."""
    return (
        rays() * depth[..., None],
        np.broadcast_to([0.0, 0.0, -1.0], (*depth.shape, 3)).copy(),
        np.isfinite(depth),
    )


# A pixel's point is within the search radius: at 5 m rows of the floor are 0.2 m apart.
@given(st.floats(-0.9, 0.9), st.floats(2.4, 5.0), st.floats(-0.1, 0.1))
def test_the_distance_over_a_floor_is_the_height_and_not_that_of_the_next_pixel(x, z, height):
    nearest = scene_distance(np.array([[x, 1.5 - height, z]]), *floor_view(), CAMERA)
    assert nearest == pytest.approx(height, abs=1e-9)


def test_distance_beyond_the_search_radius_is_infinite():
    nearest = scene_distance(
        np.array([[0.0, 1.5 - PROXIMITY_RADIUS_M - 0.01, 3.0]]), *floor_view(), CAMERA
    )
    assert nearest == np.inf
    none = scene_distance(np.zeros((0, 3)), *floor_view(), CAMERA)
    assert none.shape == (0,)


def test_under_the_plane_of_the_floor_is_inside_whatever_the_points_say():
    points, normals, valid = floor_view()
    nothing = np.zeros_like(valid)
    body = np.array([[0.0, 1.45, 3.0], [0.0, 1.53, 3.0], [0.0, 2.5, 3.0]])
    nearest = scene_distance(body, points, normals, nothing, CAMERA, Plane(UP, 1.5))
    np.testing.assert_allclose(nearest, [0.05, -0.03, -PROXIMITY_RADIUS_M], atol=1e-12)


def test_past_the_rim_of_a_surface_the_way_to_the_rim_counts():
    depth = np.full((HEIGHT, WIDTH), np.inf)
    depth[:, :80] = 2.0
    rim = (79 - CAMERA.cx) / FOCAL * 2.0
    step = 2.0 / FOCAL
    nearest = scene_distance(np.array([[rim + 0.1 + step, 0.0, 2.0]]), *wall_view(depth), CAMERA)
    assert nearest == pytest.approx(0.1, abs=0.002)


def test_points_in_free_space_are_not_inside():
    depth = np.full((HEIGHT, WIDTH), 4.0)
    depth[60:] = 2.0  # a low wall: over its top the camera sees the one behind
    points, normals, valid = wall_view(depth)
    column = 0.0
    # 10 cm behind the low wall's front, in plain view
    over = np.array([column, (57 - CAMERA.cy) / FOCAL * 2.1, 2.1])
    behind = np.array([column, (90 - CAMERA.cy) / FOCAL * 2.1, 2.1])
    nearest = scene_distance(np.stack([over, behind]), points, normals, valid, CAMERA)
    assert nearest[0] > 0
    assert nearest[1] == pytest.approx(-0.1)


def test_hidden_is_what_lies_behind_in_the_image():
    depth = np.full((HEIGHT, WIDTH), 2.0)
    depth[0] = np.inf
    centre = np.array([0.0, 0.0, 1.0])
    points = np.stack(
        [1.99 * centre, 2.02 * centre, 2.04 * centre, np.array([9.0, 0, 2.5]), -centre]
    )
    np.testing.assert_array_equal(
        hidden_by_depth_map(points, depth, CAMERA), [False, False, True, False, False]
    )


@pytest.mark.parametrize("name", ["stand", "sit_on_stool", "hug"])
def test_the_distances_of_a_world_are_measured(name):
    world = load_world(name)
    points = world.points(people=False)
    valid = np.isfinite(points).all(-1)
    distance = scene_distance(
        world.vertices, points, world.empty_normals, valid, world.intrinsics, world.floor
    )
    counted = world.outer & (
        ~hidden_by_depth_map(world.vertices, world.empty_depth, world.intrinsics) | world.contact
    )
    assert np.where(counted, distance, 0).min() > -0.02
    is_contact = world.contact & (distance < 0.05)
    assert np.median(np.abs(distance - world.distance)[is_contact]) < 0.004
