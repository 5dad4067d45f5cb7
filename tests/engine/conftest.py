"""Small scenes with a known answer: people of the embedded body on a floor, before a wall, on or
behind boxes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import roma
import torch
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from physic_core.body import load_body
from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.scene.state import SceneState
from physic_core.engine.state import State
from physic_core.geometry.floor import PlaneFit
from physic_testing.worlds import BLAZEPOSE

UP = torch.tensor([0.0, -1.0, 0.0])
FLOOR_Y = 1.3  # the camera looks level, this high over the floor
WIDTH = 320
HEIGHT = 240
FOCAL = 280.0


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
    rotations = roma.rotvec_to_rotmat(turns)
    rotations[0] = torch.diag(torch.tensor([1.0, -1.0, -1.0])) @ rotations[0]
    return rotations


def box(low, high):
    size = np.subtract(high, low)
    mesh = trimesh.creation.box(size)
    mesh.apply_translation(np.add(low, high) / 2)
    return mesh


def cast(mesh):
    """Depth (H, W), inf where nothing, and the face that is hit (H, W), by one ray a pixel."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    ray = np.stack(
        [(u - (WIDTH - 1) / 2) / FOCAL, (v - (HEIGHT - 1) / 2) / FOCAL, np.ones(u.shape)], -1
    ).reshape(-1, 3)
    face = RayMeshIntersector(mesh).intersects_first(
        np.zeros_like(ray), ray / np.linalg.norm(ray, axis=1)[:, None]
    )
    normal = mesh.face_normals[face]
    corner = mesh.triangles[face, 0]
    depth = (normal * corner).sum(1) / (normal * ray).sum(1)
    depth = np.where(face >= 0, depth, np.inf)
    return depth.reshape(HEIGHT, WIDTH), face.reshape(HEIGHT, WIDTH)


@pytest.fixture(scope="session")
def make_stage(body):
    def build(
        people,
        boxes=(),
        stands_at=FLOOR_Y,
    ):
        """People as (bends, place x, y, z), lowered or raised until their lowest vertex is at
        ``stands_at``; boxes as (low, high) corners.
        """
        rotations = torch.stack([upright(bends) for bends, _ in people])
        count = len(people)
        transl = torch.tensor([list(t) for _, t in people], dtype=torch.float32)
        betas = torch.zeros(count, body.num_betas)
        transl[:, 1] += stands_at - body(rotations, betas, transl).vertices[..., 1].amax(1)
        output = body(rotations, betas, transl)
        floor = box([-6, FLOOR_Y, 0.5], [6, FLOOR_Y + 0.1, 9])
        wall = box([-6, -3, 8], [6, FLOOR_Y, 8.1])
        room = trimesh.util.concatenate([floor, wall, *(box(low, high) for low, high in boxes)])
        depth, face = cast(room)
        owner = np.full((HEIGHT, WIDTH), -1)
        nearest = depth.copy()
        human = np.full((HEIGHT, WIDTH), np.nan)
        for i in range(count):
            mine, _ = cast(
                trimesh.Trimesh(output.vertices[i].numpy(), body.faces.numpy(), process=False)
            )
            front = mine < nearest
            nearest = np.where(front, mine, nearest)
            owner = np.where(front, i, owner)
            human = np.where(front, mine, human)
        masks = torch.from_numpy(np.stack([owner == i for i in range(count)]))
        v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
        ray = np.stack(
            [(u - (WIDTH - 1) / 2) / FOCAL, (v - (HEIGHT - 1) / 2) / FOCAL, np.ones(u.shape)], -1
        )
        known = np.isfinite(depth)
        points = np.where(known[..., None], ray * depth[..., None], 0.0)
        K = torch.tensor([[FOCAL, 0, (WIDTH - 1) / 2], [0, FOCAL, (HEIGHT - 1) / 2], [0, 0, 1]])
        landmarks = body.landmarks(output, BLAZEPOSE)
        keypoints = landmarks[..., :2] / landmarks[..., 2:] * FOCAL + K[:2, 2]
        contact = torch.zeros(count, body.num_vertices)
        for ids in body.contact_sets.values():
            contact[:, ids] = 1.0
        state = State(
            model=body,
            rotations=rotations,
            betas=betas,
            expression=torch.zeros(count, body.num_expression),
            transl=transl,
            keypoints=keypoints,
            keypoint_confidence=torch.ones(keypoints.shape[:2]),
            skeleton=BLAZEPOSE,
            K=K,
            masks=masks,
            scene=SceneState(
                points=torch.from_numpy(points).float(),
                normals=torch.from_numpy(room.face_normals[face]).float(),
                valid=torch.from_numpy(known),
                floor_points=torch.zeros(0, 3),
                K=K.double(),
                floor=PlaneFit(UP, FLOOR_Y, torch.from_numpy(known), 1.0, 0.0, "floor mask"),
            ),
            contact_prior=contact,
            observed=torch.ones(count, 55, dtype=torch.bool),
            photo_depth=torch.from_numpy(np.where(owner >= 0, human, np.nan)).float(),
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


@pytest.fixture(autouse=True)
def _one_thread():
    """Small tensors: several threads beside a busy machine are many times slower than one."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
