from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
import torch
from scipy.spatial import KDTree

from physic_core.body import load_body
from physic_core.errors import InputError
from physic_core.testing import worlds
from physic_core.testing.worlds import CONTACT_DISTANCE, WORLDS, build_world


@pytest.fixture(scope="module")
def model():
    return load_body("embedded")


def rotations(parameters):
    import roma

    order = ("global_orient", "body_pose", "jaw_pose", "leye_pose", "reye_pose", "left_hand_pose", "right_hand_pose")
    rotvecs = np.concatenate([getattr(parameters, name) for name in order], axis=1).reshape(-1, 55, 3)
    return roma.rotvec_to_rotmat(torch.tensor(rotvecs))


@pytest.mark.parametrize("name", WORLDS)
def test_the_parameters_pose_the_bodies(name, model):
    world = build_world(name)
    output = model(
        rotations(world.parameters), torch.tensor(world.parameters.betas), torch.tensor(world.parameters.transl)
    )
    np.testing.assert_allclose(output.vertices.numpy(), world.vertices, atol=1e-5)
    np.testing.assert_allclose(output.joints.numpy(), world.joints, atol=1e-5)
    assert (world.body_model, world.topology) == (model.name, model.topology)


@pytest.mark.parametrize("name", WORLDS)
@pytest.mark.parametrize("seed", [0, 7])
def test_people_stand_or_sit_without_gap_and_without_cutting_in(name, seed, model):
    world = build_world(name, seed)
    outer = model.outer.numpy()
    for i, distance in enumerate(world.distance):
        for side in ("left", "right"):
            sole = distance[model.contact_sets[f"{side}_sole"].numpy()].min()
            assert abs(sole) < 1e-3, f"{side} sole of person {i} is {1000 * sole:.2f} mm from the floor"
        assert distance[outer].min() > -1e-5
    assert world.residual.max() < 1e-3
    print(f"{name} {seed}: residual {1e6 * world.residual.max():.2f} micrometres")


@pytest.mark.parametrize("name", WORLDS)
def test_contact_is_what_lies_within_two_centimetres(name, model):
    world = build_world(name)
    np.testing.assert_array_equal(world.contact, (world.distance <= CONTACT_DISTANCE) & model.outer.numpy())
    feet = [model.part_names.index(f"{side}_foot") for side in ("left", "right")]
    on_feet = np.isin(model.part_of_vertex.numpy(), feet)
    for contact in world.contact:
        assert contact[on_feet].sum() > 200
        seated = contact[~on_feet].sum()
        assert seated > 50 if name == "sitting" else seated == 0


def test_a_sitter_touches_the_stool_with_the_seat(model):
    world = build_world("sitting")
    seat = model.contact_sets["gluteus"].numpy()
    heights = world.camera.to_room(world.vertices[0])[seat, 1]
    top = 2 * world.room.blocks[0].half[1]
    assert 0.3 < top < 0.6
    assert abs(heights.min() - top) < 0.01
    assert world.contact[0, seat].any()


def test_of_two_people_one_hides_a_part_of_the_other():
    world = build_world("two_people")
    assert len(world.masks) == 2
    assert not (world.masks[0] & world.masks[1]).any()
    np.testing.assert_array_equal(world.masks[0], world.whole_masks[0])
    hidden = 1 - world.masks[1].sum() / world.whole_masks[1].sum()
    assert 0.01 < hidden < 0.7
    assert world.visible["coco17"][1].mean() < 1


@pytest.mark.parametrize("name", WORLDS)
def test_the_pictures_agree_with_the_geometry(name):
    world = build_world(name)
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
        assert np.abs(height).max() < 1e-4
    np.testing.assert_array_equal(world.floor_mask, world.empty_floor_mask & ~people)
    in_room = world.camera.to_room(world.points(people=False).reshape(-1, 3).astype(float))
    assert np.abs(world.room.signed_distance(in_room)).max() < 1e-4


@pytest.mark.parametrize("name", WORLDS)
def test_normals_are_unit_and_face_the_camera(name):
    world = build_world(name)
    for normals, people in ((world.normals, True), (world.empty_normals, False)):
        np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1, atol=1e-5)
        assert ((normals * world.points(people=people)).sum(axis=2) <= 1e-5).all()
    np.testing.assert_allclose(
        world.normals[world.floor_mask], np.broadcast_to(world.floor.normal, (world.floor_mask.sum(), 3)), atol=1e-5
    )


@pytest.mark.parametrize("name", WORLDS)
def test_visible_keypoints_lie_on_their_person(name):
    import cv2

    world = build_world(name)
    for skeleton in worlds.SKELETONS:
        for i, mask in enumerate(world.masks):
            near = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
            u, v = world.keypoints[skeleton][i][world.visible[skeleton][i]].round().astype(int).T
            assert near[v, u].all()
        assert world.visible[skeleton].mean() > 0.5
    # Knees and wrists are the same points in both joint sets.
    coco, blazepose = world.keypoints["coco17"], world.keypoints["blazepose33"]
    np.testing.assert_allclose(coco[:, [9, 10, 13, 14]], blazepose[:, [15, 16, 25, 26]])


def test_what_hides_a_joint(model):
    sitter = build_world("sitting")
    trunk = [model.joint_names.index(name) for name in ("pelvis", "spine1", "spine2", "spine3", "neck")]
    assert sitter.joints_visible[:, trunk].all()  # covered by their own skin only
    feet = [model.joint_names.index(f"{side}_{name}") for side in ("left", "right") for name in ("ankle", "foot")]
    assert sitter.joints_visible[:, feet].all()
    front, behind = build_world("two_people").joints_visible[:, :22].sum(axis=1)
    assert front > behind


@pytest.mark.parametrize("name", WORLDS)
def test_people_are_whole_in_the_photo_and_boxes_hold_the_masks(name):
    world = build_world(name)
    assert not world.whole_masks[:, [0, -1]].any()
    assert not world.whole_masks[:, :, [0, -1]].any()
    for mask, box in zip(world.masks, world.boxes.astype(int), strict=True):
        x0, y0, x1, y1 = box
        assert mask[y0:y1, x0:x1].sum() == mask.sum()
        assert mask[y0].any()
        assert mask[:, x1 - 1].any()


def test_the_photo_shows_people_and_their_shadows():
    world = build_world("standing")
    people = world.masks.any(axis=0)
    difference = np.abs(world.image.astype(int) - world.empty_image).max(axis=2)
    assert (difference[people] > 3).mean() > 0.9
    changed = (difference[~people] > 3).mean()
    assert 0.001 < changed < 0.3
    assert world.image.std() > 25


def test_the_same_seed_builds_the_same_world_bit_for_bit():
    one, two = (worlds._build.__wrapped__("sitting", 3, (160, 120)) for _ in range(2))
    for field in fields(one):
        a, b = getattr(one, field.name), getattr(two, field.name)
        if isinstance(a, np.ndarray):
            np.testing.assert_array_equal(a, b, err_msg=field.name)
    other = build_world("sitting", 4, (160, 120))
    assert (other.image != one.image).any()
    assert one.image.shape == (120, 160, 3)


def test_worlds_are_shared_and_read_only():
    world = build_world("standing")
    assert world is build_world("standing")
    for array in (world.image, world.keypoints["coco17"], world.parameters.transl, world.floor.normal):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


def test_an_unknown_world_is_refused():
    with pytest.raises(InputError) as caught:
        build_world("flying")
    assert str(caught.value) == "There is no world named 'flying': choose one of standing, sitting, two_people."
