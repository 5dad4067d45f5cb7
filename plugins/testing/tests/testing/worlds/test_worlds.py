"""Stored worlds are photos with a truth that agrees with itself, at any size."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial import KDTree

from physic_core.body import load_body
from physic_core.types import SURFACE_NAMES
from physic_testing.conformance.cases import case_of_world
from physic_testing.conformance.truth import embedded_surface
from physic_testing.worlds import SKELETONS, load_world
from physic_testing.worlds.world import project

SIZE = (160, 120)
SAMPLE = (
    "walk_portrait",
    "group",
    "outdoor_crowd",
    "hang_from_bar",
    "hold_ball",
    "child_by_the_hand",
    "sit_on_chair_other",
    "lie_other",
)


@pytest.fixture(scope="module", params=SAMPLE)
def world(request):
    return load_world(request.param, SIZE)


def test_masks_and_depth_are_those_of_the_bodies(world):
    people = world.masks.any(axis=0)
    points = world.points(people=True)
    for mask, vertices in zip(world.masks, world.vertices, strict=True):
        distance, _ = KDTree(vertices).query(points[mask])
        assert distance.max() < 0.04  # the longest edges of the mesh are about 4 cm
    shown = people | world.item_masks.any(axis=0)
    other = world.depth[~shown] != world.empty_depth[~shown]  # at single edges
    assert other.mean() < 1e-3
    assert (world.depth[people] <= world.empty_depth[people]).all()


def test_visible_keypoints_lie_on_their_person(world):
    for skeleton in SKELETONS:
        for i, mask in enumerate(world.masks):
            near = cv2.dilate(mask.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
            pixels = world.keypoints[skeleton][i][world.visible[skeleton][i]].round().astype(int)
            u, v = np.clip(pixels, 0, np.array(mask.shape[::-1]) - 1).T
            assert near[v, u].all()


def test_the_floor_lies_on_its_plane_and_normals_face_the_camera(world):
    points = world.points(people=False)
    height = points[world.empty_floor_mask] @ world.floor.normal + world.floor.offset
    assert (np.abs(height) < 2e-4 + 1e-4 * points[world.empty_floor_mask][:, 2]).all()
    is_known = np.isfinite(points).all(axis=2)
    np.testing.assert_allclose(np.linalg.norm(world.empty_normals, axis=2), is_known, atol=1e-5)
    assert ((world.empty_normals[is_known] * points[is_known]).sum(axis=1) <= 1e-4).all()
    assert (
        np.isinf(world.empty_depth) == (world.empty_surfaces == SURFACE_NAMES.index("sky"))
    ).all()


def test_contact_is_where_the_scene_is_near(world):
    assert (world.distance[world.contact] < 0.0205).all()
    assert (world.contact == (world.touched_surface > 0)).all()
    assert not (world.contact & ~world.outer).any()


def test_the_photo_without_people_differs_at_people(world):
    people = world.masks.any(axis=0)
    apart = np.abs(world.image.astype(int) - world.empty_image).max(axis=2) > 2
    assert apart[people].mean() > 0.8
    assert not apart[0, :11].any()  # the label


@pytest.mark.parametrize("name", ["group", "walk_portrait"])
def test_another_size_shows_the_same(name):
    small = load_world(name, SIZE)
    large = load_world(name, (640, 480))
    np.testing.assert_array_equal(small.vertices, large.vertices)
    for world in (small, large):
        pixels = project(world.vertices, world.intrinsics)
        for mask, uv in zip(world.masks, pixels, strict=True):
            in_mask = np.argwhere(mask)[:, ::-1]
            assert (uv.min(axis=0) - 1 < in_mask.min(axis=0)).all()
            assert (uv.max(axis=0) + 1 > in_mask.max(axis=0)).all()
    reduced = cv2.resize(large.image, small.image.shape[1::-1], interpolation=cv2.INTER_AREA)
    assert np.abs(reduced.astype(int) - small.image).mean() < 1


def test_other_bodies_and_children_are_no_shapes_of_the_body_model():
    model = load_body("embedded")
    for name, least in (("stand", 0), ("child_by_the_hand", 1e-3), ("sit_on_chair_other", 1e-2)):
        world = load_world(name, SIZE)
        assert np.isfinite(world.ages).any() == ("child" in name)
        assert (world.body_model, world.topology) == (model.name, model.topology)
        posed = embedded_surface(case_of_world(name, world).bodies)[0]
        apart = np.linalg.norm(posed - world.vertices, axis=-1).max()
        assert least <= apart < (0.15 if least else 1e-4)


def test_views_of_one_moment_show_the_same_people_in_the_room():
    views = [load_world(f"group_view{i}", SIZE) for i in (1, 2, 3)]
    in_room = [view.vertices @ view.camera_rotation + view.camera_position for view in views]
    for other in in_room[1:]:
        np.testing.assert_allclose(other, in_room[0], atol=1e-4)
    places = np.array([view.camera_position for view in views])
    assert np.linalg.norm(places[:, None] - places, axis=-1)[np.triu_indices(3, 1)].min() > 0.5


def test_arrays_are_read_only():
    world = load_world("stand", SIZE)
    for array in (world.image, world.parameters.betas, world.floor.normal):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
