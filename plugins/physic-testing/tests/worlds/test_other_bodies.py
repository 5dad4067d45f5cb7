"""Worlds whose people have a body that no shape of the body model has; their truth is exact on the
same mesh.
"""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_core.body import load_body
from physic_testing.worlds import CONTACT_DISTANCE, OTHER_BODIES, SKELETONS, build_world
from physic_testing.worlds.ground_truth import project
from physic_testing.worlds.other_bodies import other_body
from physic_testing.worlds.posing import pose_body, rest_body


@pytest.fixture(scope="module")
def model():
    return load_body("embedded").to(dtype=torch.float64)


@pytest.fixture(scope="module")
def world():
    return build_world("stand" + OTHER_BODIES, 0)


def test_no_shape_of_the_model_explains_the_body(model):
    changed = other_body(model, np.random.default_rng(3))
    zero = np.zeros(model.num_betas)
    vertices, joints = rest_body(changed, zero)
    own_vertices, own_joints = rest_body(model, zero)
    directions = np.stack(
        [np.concatenate(rest_body(model, row)) for row in np.eye(model.num_betas)]
    )
    directions = (directions - np.concatenate([own_vertices, own_joints])).reshape(
        model.num_betas, -1
    )
    wanted = (
        np.concatenate([vertices, joints]) - np.concatenate([own_vertices, own_joints])
    ).reshape(-1)
    betas = np.linalg.lstsq(directions.T, wanted, rcond=None)[0]
    left = np.linalg.norm((wanted - betas @ directions).reshape(-1, 3), axis=1)
    assert left.mean() > 0.004
    assert left.max() < 0.15


def test_shape_components_act_on_the_body_as_on_the_model(model):
    changed = other_body(model, np.random.default_rng(3))
    betas = np.full(model.num_betas, 0.5)
    taller = np.ptp(rest_body(changed, betas)[0][:, 1]) - np.ptp(
        rest_body(changed, -betas)[0][:, 1]
    )
    assert taller == pytest.approx(
        np.ptp(rest_body(model, betas)[0][:, 1]) - np.ptp(rest_body(model, -betas)[0][:, 1]),
        rel=0.3,
    )


def test_the_truth_is_that_of_the_other_body(world, model):
    base = build_world("stand", 0)
    assert world.name == "stand" + OTHER_BODIES
    assert world.action == base.action
    assert world.vertices.shape[1:] == base.vertices.shape[1:]
    fitted, joints = pose_body(
        model,
        np.concatenate(
            [world.parameters.global_orient[0], world.parameters.body_pose[0], np.zeros(99)]
        ).reshape(55, 3),
        world.parameters.betas[0],
        world.parameters.transl[0],
    )
    assert joints[0] == pytest.approx(world.joints[0, 0], abs=1e-5)
    assert np.linalg.norm(fitted - world.vertices[0], axis=1).mean() > 0.01
    distance = world.room.signed_distance(world.camera.to_room(world.vertices.astype(np.float64)))
    assert np.array_equal(world.contact, (world.distance <= CONTACT_DISTANCE) & world.outer)
    assert distance == pytest.approx(world.distance, abs=1e-5)
    assert world.contact.any()
    names = SKELETONS["coco17"].names
    row = names.index("left_knee")
    assert world.keypoints["coco17"][0, row] == pytest.approx(
        project(world.joints[0, 4], world.intrinsics), abs=6
    )
