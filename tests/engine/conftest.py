"""Small scenes with a known answer: people of the embedded body on a floor, before a wall, on or
behind boxes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import torch
import trimesh

from physic_core.body import load_body
from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.scene_state import SceneState
from physic_core.engine.state import State
from physic_core.geometry.camera import project
from physic_core.geometry.floor import PlaneFit
from physic_core.geometry.rotvecs import rotvec_to_rotmat
from physic_core.types import Intrinsics
from physic_testing.worlds import BLAZEPOSE

from .seen import rays_of, seen

UP = torch.tensor([0.0, -1.0, 0.0])
FLOOR_Y = 1.3  # the camera looks level, this high over the floor
CAMERA = Intrinsics.from_focal(280.0, 320, 240)


@dataclass(frozen=True)
class Stage:
    """True people in a scene, and the problem that starts at the truth."""

    state: State
    vertices: torch.Tensor
    joints: torch.Tensor


@pytest.fixture(scope="session")
def body():
    return load_body("embedded")


def upright(bends):
    """(55, 3, 3) facing the camera, arms down; further rotation vectors by joint name."""
    turns = torch.zeros(55, 3)
    turns[JOINT_INDEX["left_shoulder"], 2] = -1.2
    turns[JOINT_INDEX["right_shoulder"], 2] = 1.2
    for name, turn in bends.items():
        turns[JOINT_INDEX[name]] = torch.tensor(list(turn))
    rotations = rotvec_to_rotmat(turns)
    rotations[0] = torch.diag(torch.tensor([1.0, -1.0, -1.0])) @ rotations[0]
    return rotations


def box(low, high):
    size = np.subtract(high, low)
    mesh = trimesh.creation.box(size)
    mesh.apply_translation(np.add(low, high) / 2)
    return mesh


def plane_of(normal, offset, inliers=None):
    """The floor of no map, or of the pixels (H, W) of one."""
    inliers = torch.zeros(2, 2, dtype=torch.bool) if inliers is None else inliers
    return PlaneFit(normal, offset, inliers, 1.0, 0.0, "floor mask")


def state_of(body, rotations, betas, transl, *, depth, floor, normals=None, **people):
    """The state of people before a scene of a depth (H, W), NaN where it is unknown."""
    count = len(transl)
    camera = people.pop("camera", CAMERA)
    K = torch.from_numpy(camera.matrix)
    known = torch.from_numpy(np.isfinite(depth))
    points = np.where(known[..., None], rays_of(camera) * depth[..., None], 0.0)
    points = torch.from_numpy(points).float()
    scene = SceneState(
        points=points,
        normals=torch.zeros_like(points) if normals is None else normals,
        valid=known,
        floor_points=torch.zeros(0, 3),
        K=K,
        floor=None if floor is None else plane_of(*floor, known),
    )
    given = {
        "model": body,
        "expression": torch.zeros(count, body.num_expression),
        "observed": torch.ones(count, 55, dtype=torch.bool),
    }
    return State(
        rotations=rotations, betas=betas, transl=transl, K=K.float(), scene=scene, **given | people
    )


@pytest.fixture(scope="session")
def make_stage(body):
    def build(people, boxes=(), stands_at=FLOOR_Y):
        """People as (bends, place x, y, z), lowered or raised until their lowest vertex is at
        ``stands_at``; boxes as (low, high) corners.
        """
        rotations = torch.stack([upright(bends) for bends, _ in people])
        transl = torch.tensor([list(t) for _, t in people], dtype=torch.float32)
        betas = torch.zeros(len(people), body.num_betas)
        transl[:, 1] += stands_at - body(rotations, betas, transl).vertices[..., 1].amax(1)
        output = body(rotations, betas, transl)
        floor = box([-6, FLOOR_Y, 0.5], [6, FLOOR_Y + 0.1, 9])
        wall = box([-6, -3, 8], [6, FLOOR_Y, 8.1])
        room = trimesh.util.concatenate([floor, wall, *(box(low, high) for low, high in boxes)])
        depth, face = seen(room.vertices, room.faces, CAMERA)
        surfaces = np.stack([depth, *(seen(v, body.faces, CAMERA)[0] for v in output.vertices)])
        nearest = surfaces.argmin(0)
        landmarks = body.landmarks(output, BLAZEPOSE)
        keypoints = project(landmarks, torch.from_numpy(CAMERA.matrix).float())
        contact = torch.zeros(len(people), body.num_vertices)
        for ids in body.contact_sets.values():
            contact[:, ids] = 1.0
        state = state_of(
            body,
            rotations,
            betas,
            transl,
            depth=depth,
            floor=(UP, FLOOR_Y),
            normals=torch.from_numpy(room.face_normals[face]).float(),
            keypoints=keypoints,
            keypoint_confidence=torch.ones(keypoints.shape[:2]),
            skeleton=BLAZEPOSE,
            masks=torch.from_numpy(np.stack([nearest == i + 1 for i in range(len(people))])),
            contact_prior=contact,
            photo_depth=torch.from_numpy(np.where(nearest > 0, surfaces.min(0), np.nan)).float(),
        )
        return Stage(state, output.vertices, output.joints)

    return build


@pytest.fixture(scope="session")
def standing(make_stage):
    """One who stands in an empty room."""
    return make_stage([({}, (0.0, 0.0, 3.5))])


@pytest.fixture(scope="session")
def two(make_stage):
    """Two who stand apart."""
    return make_stage([({}, (-0.6, 0.0, 3.5)), ({}, (0.5, 0.0, 4.2))])


@pytest.fixture(scope="session")
def with_box(make_stage):
    """Two who stand apart, the first one partly in a box."""
    people = [({}, (-0.6, 0.0, 3.2)), ({}, (0.5, 0.0, 3.8))]
    return make_stage(people, boxes=[((-0.9, 0.8, 3.3), (0.9, 1.3, 3.6))])


@pytest.fixture(scope="session")
def behind_box(make_stage):
    """One whose legs a box hides, right before them."""
    return make_stage([({}, (0.0, 0.0, 3.2))], boxes=[((-0.6, 0.55, 2.9), (0.6, 1.3, 3.12))])


@pytest.fixture(autouse=True)
def _one_thread():
    """Small tensors: several threads beside a busy machine are many times slower than one."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
