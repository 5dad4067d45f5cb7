from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial import KDTree

from physic_core.body import load_body
from physic_core.errors import InputError
from physic_testing.worlds import (
    CONTACT_DISTANCE,
    World,
    build_world,
)
from physic_testing.worlds import world as worlds

SIZE = (192, 144)
SAMPLE = ("stand", "sit_on_stool", "stand_behind_counter", "hug", "slope")


@pytest.fixture(scope="module")
def model():
    return load_body("embedded")


@pytest.fixture(scope="module", params=SAMPLE)
def world(request) -> World:
    return build_world(request.param, 0, SIZE)


def rotations(parameters):
    import roma

    order = (
        "global_orient",
        "body_pose",
        "jaw_pose",
        "leye_pose",
        "reye_pose",
        "left_hand_pose",
        "right_hand_pose",
    )
    rotvecs = np.concatenate([getattr(parameters, name) for name in order], axis=1).reshape(
        -1, 55, 3
    )
    return roma.rotvec_to_rotmat(torch.tensor(rotvecs))


def test_the_parameters_pose_the_bodies(world, model):
    output = model(
        rotations(world.parameters),
        torch.tensor(world.parameters.betas),
        torch.tensor(world.parameters.transl),
    )
    np.testing.assert_allclose(output.vertices.numpy(), world.vertices, atol=1e-5)
    np.testing.assert_allclose(output.joints.numpy(), world.joints, atol=1e-5)
    assert (world.body_model, world.topology) == (model.name, model.topology)
    assert world.action == (world.name,) * len(world.masks) or world.name in (
        "group",
        "slope",
        "outdoor_steps",
    )


def test_people_touch_the_scene_and_enter_it_by_a_centimetre_at_most(world):
    for distance in world.distance:
        assert -0.01 < distance[world.outer].min() < CONTACT_DISTANCE
    assert world.contact.any(axis=1).all()


def test_the_distance_is_that_to_the_rooms_surfaces(world):
    in_room = world.camera.to_room(world.vertices.astype(float))
    np.testing.assert_allclose(world.room.signed_distance(in_room), world.distance, atol=1e-5)
    np.testing.assert_array_equal(world.contact, (world.distance <= CONTACT_DISTANCE) & world.outer)


def test_other_people_are_no_scene(world):
    """Without blocks and walls the distance is the height over the ground, however near the others
    are.
    """
    on_plane = world.vertices @ world.floor.normal + world.floor.offset
    assert (world.distance <= on_plane + 1e-4).all()


def test_the_pictures_agree_with_the_geometry(world):
    people = world.masks.any(axis=0)
    points = world.points(people=True)
    for mask, vertices in zip(world.masks, world.vertices, strict=True):
        distance, _ = KDTree(vertices).query(points[mask])
        assert distance.max() < 0.03  # the longest edges of the mesh are about 4 cm
    np.testing.assert_array_equal(world.depth[~people], world.empty_depth[~people])
    assert (world.depth[people] <= world.empty_depth[people]).all()
    for image_points, floor in (
        (points, world.floor_mask),
        (world.points(people=False), world.empty_floor_mask),
    ):
        height = image_points[floor] @ world.floor.normal + world.floor.offset
        assert (np.abs(height) < 1e-4 + 1e-6 * image_points[floor][:, 2]).all()
    np.testing.assert_array_equal(world.floor_mask, world.empty_floor_mask & ~people)
    empty = world.points(people=False)
    near = np.isfinite(empty).all(axis=2) & (world.empty_depth < 20)
    in_room = world.camera.to_room(empty[near].astype(float))
    assert np.abs(world.room.signed_distance(in_room)).max() < 1e-4


def test_the_sky_is_infinitely_far_and_nothing_else():
    world = build_world("slope", 0, SIZE)
    sky = np.isinf(world.empty_depth)
    assert world.room.walls is None
    assert sky.any()
    assert np.isinf(world.points(people=False)[sky]).all()
    assert not world.empty_normals[sky].any()
    assert not (world.empty_floor_mask & sky).any()
    assert not np.isinf(world.depth[world.masks.any(axis=0)]).any()
    assert not np.isnan(world.points(people=True)).any()


def test_normals_are_unit_and_face_the_camera(world):
    for normals, people in ((world.normals, True), (world.empty_normals, False)):
        points = world.points(people=people)
        seen = np.isfinite(points).all(axis=2)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=2), seen, atol=1e-5)
        assert ((normals[seen] * points[seen]).sum(axis=1) <= 1e-4).all()
    np.testing.assert_allclose(
        world.normals[world.floor_mask],
        np.broadcast_to(world.floor.normal, (world.floor_mask.sum(), 3)),
        atol=1e-5,
    )


def test_visible_keypoints_lie_on_their_person(world):
    import cv2

    for skeleton in worlds.SKELETONS:
        for i, mask in enumerate(world.masks):
            near = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
            u, v = world.keypoints[skeleton][i][world.visible[skeleton][i]].round().astype(int).T
            assert near[v, u].all()
        assert world.visible[skeleton].mean() > 0.2
    # Knees and wrists are the same points in both joint sets.
    coco = world.keypoints["coco17"]
    blazepose = world.keypoints["blazepose33"]
    np.testing.assert_allclose(coco[:, [9, 10, 13, 14]], blazepose[:, [15, 16, 25, 26]])


def test_masks_part_the_people_and_boxes_hold_them(world):
    assert world.masks.sum(axis=0).max() == 1
    for mask, whole, box in zip(
        world.masks, world.unoccluded_masks, world.boxes.astype(int), strict=True
    ):
        assert not (mask & ~whole).any()
        assert mask.sum() > 0.2 * whole.sum()
        x0, y0, x1, y1 = box
        assert mask[y0:y1, x0:x1].sum() == mask.sum()
        assert mask[[y0, y1 - 1]].any(axis=1).all()
        assert mask[:, [x0, x1 - 1]].any(axis=0).all()


def test_people_are_whole_in_the_photo_where_the_action_is():
    for name in ("stand", "sit_on_stool"):
        whole = build_world(name, 0, SIZE).unoccluded_masks
        assert not whole[:, [0, -1]].any()
        assert not whole[:, :, [0, -1]].any()


def test_an_unknown_world_is_refused():
    with pytest.raises(InputError, match=r"no world named 'flying': choose one of .*stand"):
        build_world("flying")
