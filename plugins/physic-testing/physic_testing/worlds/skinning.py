"""Linear blend skinning with gradient for a body of fixed shape, bit-identical on every CPU."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.worlds.reproducible_math import apply, matmul

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray

    Ids = NDArray[np.int64]

__all__ = ["Skinner"]


class Skinner:
    """Linear blend skinning of a body with fixed shape.

    Args:
        model: body model in float64, without pose correctives.
        betas: (K,) shape.
        ids: (n,) vertices that are posed; by default all.
    """

    def __init__(self, model: BodyModel, betas: FloatArray, ids: Ids | None = None) -> None:
        rig = _rig_of(model)
        chosen = slice(None) if ids is None else ids
        self._rig, self._bones, self._weights = rig, rig.bones[chosen], rig.weights[chosen]
        shaped, rest = rig.template[chosen], rig.joints
        for beta, vertices, joints in zip(
            np.asarray(betas, np.float64), rig.directions, rig.joint_directions, strict=True
        ):
            shaped, rest = shaped + beta * vertices[chosen], rest + beta * joints
        self._shaped, self._rest = shaped, rest
        offsets = rest - rest[rig.parents]
        offsets[0] = rest[0]
        self._offsets = np.concatenate([offsets[:1], apply(rig.bind[rig.parents[1:]], offsets[1:])])

    def __call__(self, rotations: FloatArray, transl: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return vertices (n, 3) and joints (55, 3), m, for rotations (55, 3, 3) and transl (3,)."""
        rig = self._rig
        world, places = rotations.copy(), self._offsets.copy()
        for joints, parents in rig.levels:
            places[joints] = places[parents] + apply(world[parents], self._offsets[joints])
            world[joints] = matmul(world[parents], rotations[joints])
        turns = matmul(world, rig.bind)
        bones = np.concatenate([turns.reshape(-1, 9), places - apply(turns, self._rest)], axis=1)
        mixed = self._weights[:, :1] * bones[self._bones[:, 0]]
        for k in range(1, self._bones.shape[1]):
            mixed += self._weights[:, k, None] * bones[self._bones[:, k]]
        self._rotations, self._world = rotations, world
        vertices = apply(mixed[:, :9].reshape(-1, 3, 3), self._shaped) + mixed[:, 9:] + transl
        return vertices, places + transl

    def gradient(self, by_vertices: FloatArray, by_joints: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Convert a gradient by vertices and joints to a gradient by rotations and translation, at the last pose."""
        rig, count = self._rig, len(self._rest)
        by_transl = by_vertices.sum(axis=0) + by_joints.sum(axis=0)
        pulled = np.flatnonzero((by_vertices != 0).any(axis=1))
        pull, shaped = by_vertices[pulled], self._shaped[pulled]
        by_mixed = np.concatenate([(pull[:, :, None] * shaped[:, None, :]).reshape(-1, 9), pull], axis=1)
        weights, flat = self._weights[pulled], self._bones[pulled].reshape(-1)
        by_bones = np.stack(
            [np.bincount(flat, (weights * by_mixed[:, c, None]).reshape(-1), count) for c in range(12)], axis=1
        )
        by_shift = by_bones[:, 9:]
        by_turn = by_bones[:, :9].reshape(-1, 3, 3) - by_shift[:, :, None] * self._rest[:, None, :]
        by_world = matmul(by_turn, np.swapaxes(rig.bind, 1, 2))
        by_place = by_shift + by_joints
        by_rotations = np.zeros_like(by_world)
        for joints, parents in reversed(rig.levels):
            upper = self._world[parents]
            by_rotations[joints] = matmul(np.swapaxes(upper, 1, 2), by_world[joints])
            pull_up = matmul(by_world[joints], np.swapaxes(self._rotations[joints], 1, 2))
            pull_up += by_place[joints][:, :, None] * self._offsets[joints][:, None, :]
            np.add.at(by_world, parents, pull_up)
            np.add.at(by_place, parents, by_place[joints])
        by_rotations[0] = by_world[0]
        return by_rotations, by_transl


@dataclass(frozen=True, eq=False)
class _Rig:
    """Arrays of a body model.

    Attributes:
        template: (V, 3) rest vertices.
        directions: (K, V, 3) shape directions of the vertices.
        bones: (V, k) bones of each vertex.
        weights: (V, k) skinning weights.
        joints: (J, 3) rest joints.
        joint_directions: (K, J, 3) shape directions of the joints.
        bind: (J, 3, 3) rotations from the bind pose.
        parents: (J,) parent of each joint.
        levels: joints and parents of each level of the tree, from the root outwards.
    """

    template: FloatArray
    directions: FloatArray
    bones: Ids
    weights: FloatArray
    joints: FloatArray
    joint_directions: FloatArray
    bind: FloatArray
    parents: Ids
    levels: tuple[tuple[Ids, Ids], ...]


@lru_cache(maxsize=4)
def _rig_of(model: BodyModel) -> _Rig:
    """Return the arrays of a body model; recent ones are cached."""
    skin, kinematics, shapes = model.skin, model.kinematics, model.num_betas
    if len(skin.directions) > shapes + model.num_expression:
        raise ValueError(f"Worlds pose bodies without pose correctives: the {model.name} body has some.")
    weights = np.ascontiguousarray(skin.weights.double().numpy().T)
    most = int((weights > 0).sum(axis=1).max())
    bones = np.argsort(-weights, axis=1, kind="stable")[:, :most]
    count, parents = weights.shape[1], kinematics.parents.numpy()
    depth = np.zeros(count, np.int64)
    for joint in range(1, count):
        depth[joint] = depth[parents[joint]] + 1
    levels = [np.flatnonzero(depth == level) for level in range(1, int(depth.max()) + 1)]
    bind = np.tile(np.eye(3), (count, 1, 1)) if kinematics.bind_rot is None else kinematics.bind_rot.double().numpy()
    return _Rig(
        template=np.ascontiguousarray(skin.template.double().numpy().T),
        directions=np.ascontiguousarray(skin.directions[:shapes].double().numpy().transpose(0, 2, 1)),
        bones=bones,
        weights=np.take_along_axis(weights, bones, axis=1),
        joints=kinematics.template.double().numpy(),
        joint_directions=kinematics.directions[:shapes].double().numpy().reshape(shapes, count, 3),
        bind=bind,
        parents=parents,
        levels=tuple((joints, parents[joints]) for joints in levels),
    )
