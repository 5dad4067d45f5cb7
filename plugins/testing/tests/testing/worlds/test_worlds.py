"""Stored worlds are photos with a truth that agrees with itself, at any size."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial import KDTree

from physic_core.types import SURFACE_NAMES
from physic_testing.worlds import SKELETONS, load_world

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


def test_arrays_are_read_only():
    world = load_world("stand", SIZE)
    for array in (world.image, world.parameters.betas, world.floor.normal):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
