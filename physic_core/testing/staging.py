"""Puts people and furniture into a room so that they touch and do not cut into each other, and aims the camera.

The room's frame (x right, y up, z towards the camera's side, floor y = 0), metres.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.errors import InputError
from physic_core.testing.poses import bend_leg, sitting, standing
from physic_core.testing.rooms import Block, Room, yaw_matrix

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray, Intrinsics

__all__ = ["WORLDS", "Actor", "Camera", "Stage", "pose_vertices", "set_stage"]

WORLDS = ("standing", "sitting", "two_people")
"""Names of the worlds."""

_SEAT_HALF = (0.24, 0.21)  # half width and depth of the stool, m
_KNEE_GAP = 0.11  # from the knee joint back to the front edge of the seat, m


@dataclass(frozen=True)
class Actor:
    """A settled person.

    Attributes:
        pose: (55, 3) rotation vectors, radians; row 0 is the turn about y.
        betas: (K,).
        transl: (3,) metres.
        residual: metres by which at most a sole misses the floor, or a vertex lies inside floor or furniture.
    """

    pose: FloatArray
    betas: FloatArray
    transl: FloatArray
    residual: float


@dataclass(frozen=True)
class Camera:
    """Where the photo is taken from.

    Attributes:
        rotation: (3, 3), room's axes to the camera's (OpenCV: x right, y down, z forward).
        position: (3,) of the camera in the room; its y is the height over the floor.
    """

    rotation: FloatArray
    position: FloatArray

    def to_camera(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) of the room -> camera frame."""
        moved: FloatArray = (points - self.position) @ self.rotation.T
        return moved

    def to_room(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) of the camera frame -> room."""
        moved: FloatArray = points @ self.rotation + self.position
        return moved


@dataclass(frozen=True)
class Stage:
    """A furnished room with its people and its camera."""

    room: Room
    actors: tuple[Actor, ...]
    camera: Camera


def pose_vertices(
    model: BodyModel, pose: FloatArray, betas: FloatArray, transl: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pose (55, 3), betas (K,), transl (3,) -> vertices (V, 3) and joints (55, 3), in the frame of the root's turn."""
    import roma
    import torch

    def tensor(x: FloatArray) -> torch.Tensor:
        return torch.as_tensor(np.ascontiguousarray(x)[None], dtype=model.dtype)

    with torch.no_grad():
        output = model(roma.rotvec_to_rotmat(tensor(pose)), tensor(betas), tensor(transl))
    return output.vertices[0].numpy(), output.joints[0].numpy()


def set_stage(model: BodyModel, name: str, rng: np.random.Generator, intrinsics: Intrinsics, seed: int) -> Stage:
    """Build one of WORLDS.

    Raises:
        InputError: there is no such world.
    """
    if name == "standing":
        actors: tuple[Actor, ...] = (_stand(model, rng, (0.0, 0.0)),)
        blocks: tuple[Block, ...] = (_stool(rng, (0.95, -0.35)),)
    elif name == "sitting":
        actor, seat = _sit(model, rng, (0.0, 0.0))
        actors, blocks = (actor,), (seat,)
    elif name == "two_people":
        side = rng.choice([-1.0, 1.0])
        actors = (_stand(model, rng, (-0.22 * side, 0.1)), _stand(model, rng, (0.30 * side, -0.65)))
        blocks = (_stool(rng, (1.25 * side, -0.1)),)
    else:
        raise InputError(f"There is no world named {name!r}: choose one of {', '.join(WORLDS)}.")
    bench = Block((rng.uniform(-0.9, -0.5), 0.21, -1.75), (0.75, 0.21, 0.32), material="fabric")
    people = np.concatenate([pose_vertices(model, a.pose, a.betas, a.transl)[0] for a in actors])
    camera = _aim(people, rng, intrinsics)
    right = max(2.4, camera.position[0] + 0.8)
    left = min(-2.2, camera.position[0] - 0.8)
    room = Room((left, 0.0, -2.15), (right, 2.7, camera.position[2] + 0.8), (*blocks, bench), seed)
    actors = tuple(replace(a, residual=_residual(model, a, room)) for a in actors)
    return Stage(room, actors, camera)


def _stool(rng: np.random.Generator, place: tuple[float, float]) -> Block:
    height = rng.uniform(0.40, 0.50)
    return Block((place[0], height / 2, place[1]), (0.2, height / 2, 0.2), rng.uniform(-0.6, 0.6))


def _shape(model: BodyModel, rng: np.random.Generator) -> FloatArray:
    return np.clip(rng.normal(0, 0.6, model.num_betas), -1.2, 1.2)


def _stand(model: BodyModel, rng: np.random.Generator, place: tuple[float, float]) -> Actor:
    """A person whose two soles touch the floor: the longer leg is bent until both do."""
    betas, pose = _shape(model, rng), standing(rng)
    pose[0] = (0, np.radians(rng.uniform(-40, 40)), 0)

    def soles(candidate: FloatArray) -> tuple[float, float]:
        vertices, _ = pose_vertices(model, candidate, betas, np.zeros(3))
        left, right = (float(vertices[model.contact_sets[f"{s}_sole"].numpy(), 1].min()) for s in ("left", "right"))
        return left, right

    left, right = soles(pose)
    longer = 0 if left < right else 1
    low, high = 0.0, 25.0
    for _ in range(12):
        middle = (low + high) / 2
        heights = soles(bend_leg(pose, ("left", "right")[longer], middle))
        if heights[longer] < heights[1 - longer]:
            low = middle
        else:
            high = middle
    pose = bend_leg(pose, ("left", "right")[longer], (low + high) / 2)
    vertices, joints = pose_vertices(model, pose, betas, np.zeros(3))
    transl = np.array([place[0] - joints[0, 0], -vertices[model.outer.numpy(), 1].min(), place[1] - joints[0, 2]])
    return Actor(pose, betas, transl, residual=0.0)


def _sit(model: BodyModel, rng: np.random.Generator, place: tuple[float, float]) -> tuple[Actor, Block]:
    """A person with soles on the floor, and a stool cut to the height of their seat.

    The hips' bend is the one of a few whose seat and thighs lie closest to the stool.
    """
    betas, state, yaw = _shape(model, rng), rng.bit_generator.state, np.radians(rng.uniform(-45, 45))
    outer = model.outer.numpy()
    touching = np.concatenate([model.contact_sets[name].numpy() for name in ("gluteus", "thighs")])
    best: tuple[float, FloatArray, FloatArray, Block] | None = None
    for thigh in (78.0, 82.0, 86.0, 90.0, 94.0):
        rng.bit_generator.state = state
        pose = sitting(rng, thigh)
        pose[0] = (0, yaw, 0)
        vertices, joints = pose_vertices(model, pose, betas, np.zeros(3))
        transl = np.array([place[0] - joints[0, 0], -vertices[outer, 1].min(), place[1] - joints[0, 2]])
        vertices, joints = vertices + transl, joints + transl
        facing = yaw_matrix(yaw)
        knees, pelvis = (joints[4] + joints[5]) / 2, joints[0]
        front = float((knees - pelvis) @ facing[:, 2]) - _KNEE_GAP
        middle = pelvis + facing[:, 2] * (front - _SEAT_HALF[1])
        seat = Block((middle[0], 0.0, middle[2]), (_SEAT_HALF[0], 0.0, _SEAT_HALF[1]), yaw)
        local = seat.to_local(vertices)
        over = outer & (np.abs(local[:, 0]) <= _SEAT_HALF[0]) & (np.abs(local[:, 2]) <= _SEAT_HALF[1])
        height = float(vertices[over, 1].min())
        seat = Block((middle[0], height / 2, middle[2]), (_SEAT_HALF[0], height / 2, _SEAT_HALF[1]), yaw)
        on_seat = touching[over[touching]]
        gap = float((vertices[on_seat, 1] - height).mean())
        if best is None or gap < best[0]:
            best = (gap, pose, transl, seat)
    assert best is not None
    _, pose, transl, seat = best
    return Actor(pose, betas, transl, residual=0.0), seat


def _residual(model: BodyModel, actor: Actor, room: Room) -> float:
    """The largest of: height of a sole over the floor, and depth of a vertex in the floor or in furniture."""
    vertices, _ = pose_vertices(model, actor.pose, actor.betas, actor.transl)
    soles = [abs(float(vertices[model.contact_sets[f"{s}_sole"].numpy(), 1].min())) for s in ("left", "right")]
    deepest = -float(room.signed_distance(vertices[model.outer.numpy()]).min())
    return max(*soles, deepest)


def _aim(people: FloatArray, rng: np.random.Generator, intrinsics: Intrinsics) -> Camera:
    """Look at the people's middle from the front, from as near as shows them whole."""
    height, side = rng.uniform(1.2, 1.7), np.radians(rng.uniform(-12, 12))
    low, high = people.min(axis=0), people.max(axis=0)
    target = (low + high) / 2 + np.array([rng.uniform(-0.1, 0.1), 0.0, 0.0])
    near, far = 1.0, 12.0
    for _ in range(30):
        distance = (near + far) / 2
        camera = _look(target, distance, height, side)
        points = camera.to_camera(people)
        uv = points[:, :2] / np.maximum(points[:, 2:], 1e-3) * [intrinsics.fx, intrinsics.fy]
        uv += [intrinsics.cx, intrinsics.cy]
        margin = 0.05 * intrinsics.height
        size = np.array([intrinsics.width, intrinsics.height])
        shown = (points[:, 2] > 0.3).all() and (uv > margin).all() and (uv < size - margin).all()
        near, far = (near, distance) if shown else (distance, far)
    return _look(target, far, height, side)


def _look(target: FloatArray, distance: float, height: float, side: float) -> Camera:
    position = np.array([target[0] + distance * np.sin(side), height, target[2] + distance * np.cos(side)])
    forward = target - position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    return Camera(np.stack([right, np.cross(forward, right), forward]), position)
