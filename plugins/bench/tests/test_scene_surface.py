"""Signed distance to a scan: against closed forms, and against every triangle one by one."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from physic_bench.scene_surface import SceneIndex, contact_by_rule
from physic_bench.types import Surface
from physic_core.errors import InputError


def surface(mesh):
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def test_a_large_box_has_the_distance_of_a_box():
    index = SceneIndex.build(surface(trimesh.creation.box((4, 2, 3))))
    points = np.random.default_rng(0).uniform(-2.4, 2.4, (500, 3))
    outside = np.abs(points) - np.array([2, 1, 1.5])
    expected = np.linalg.norm(np.maximum(outside, 0), axis=1) + np.minimum(outside.max(1), 0)
    distance = index.signed_distance(points, reach=0.5)
    near = np.abs(expected) < 0.5
    assert near.sum() > 100
    np.testing.assert_allclose(distance, np.where(near, expected, np.inf), atol=1e-9)


def test_near_points_are_exact_on_a_scan_of_mixed_triangles():
    rng = np.random.default_rng(1)
    mesh = trimesh.creation.icosphere(3, 0.5)
    mesh.vertices += 0.02 * rng.standard_normal(mesh.vertices.shape)
    floor = trimesh.creation.box((6, 6, 0.1)).apply_translation([0, 0, -0.7])
    both = trimesh.util.concatenate([mesh, floor])
    points = rng.uniform(-0.8, 0.8, (150, 3))
    corners = both.vertices[both.faces]
    every = np.repeat(points, len(corners), axis=0)
    on = trimesh.triangles.closest_point(np.tile(corners, (150, 1, 1)), every)
    apart = np.linalg.norm(on - every, axis=-1).reshape(150, -1).min(1)
    distance = np.abs(SceneIndex.build(surface(both)).signed_distance(points))
    near = apart < 0.15
    assert near.sum() > 50
    np.testing.assert_allclose(distance[near], apart[near], atol=1e-9)
    assert np.isinf(distance[~near]).all()


def test_contact_is_near_or_a_little_inside():
    distance = np.array([0.019, 0.021, -0.019, -0.14, -0.16, np.inf])
    assert contact_by_rule(distance, 0.02).tolist() == [True, False, True, True, False, False]


def test_beyond_reach_is_infinite_and_points_without_triangles_are_refused():
    index = SceneIndex.build(surface(trimesh.creation.box((1, 1, 1))))
    assert np.isposinf(index.signed_distance(np.array([[0, 0, 3.0], [np.nan, 0, 0]]))).all()
    with pytest.raises(InputError, match="the mesh of the scene has no triangles"):
        SceneIndex.build(Surface(np.zeros((4, 3)), np.zeros((0, 3), int)))
