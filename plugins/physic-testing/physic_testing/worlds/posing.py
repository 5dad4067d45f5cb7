"""Linear blend skinning of one body, bit-identical on every CPU.

The model's own product of matrices differs in the last bit between kernels, and decisions of a
world would amplify it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.worlds.reproducible_math import apply, matmul, rotation_matrix

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray

    Ids = NDArray[np.int64]

__all__ = ["pose_body", "rest_body"]


def rest_body(model: BodyModel, betas: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Return vertices (V, 3) and joints (55, 3) of the T-pose, m, of a shape (K,); by default the
    mean shape.
    """
    shape = np.zeros(model.num_betas) if betas is None else betas
    return pose_body(model, np.zeros((55, 3)), shape, np.zeros(3))


def pose_body(
    model: BodyModel, pose: FloatArray, betas: FloatArray, transl: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pose a body.

    Args:
        model: body model in float64, without pose correctives.
        pose: (55, 3) rotation vectors, radians.
        betas: (K,) shape.
        transl: (3,) translation, m.

    Returns:
        Vertices (V, 3) and joints (55, 3), m.
    """
    rig = _rig_of(model)
    shaped = rig.template
    rest = rig.joints
    for beta, vertices, joints in zip(
        np.asarray(betas, np.float64), rig.directions, rig.joint_directions, strict=True
    ):
        shaped = shaped + beta * vertices
        rest = rest + beta * joints
    offsets = rest - rest[rig.parents]
    offsets[0] = rest[0]
    offsets = np.concatenate([offsets[:1], apply(rig.bind[rig.parents[1:]], offsets[1:])])
    world = rotation_matrix(np.asarray(pose, np.float64))
    places = offsets.copy()
    for joints, parents in rig.levels:
        places[joints] = places[parents] + apply(world[parents], offsets[joints])
        world[joints] = matmul(world[parents], world[joints])
    turns = matmul(world, rig.bind)
    bones = np.concatenate([turns.reshape(-1, 9), places - apply(turns, rest)], axis=1)
    mixed = rig.weights[:, :1] * bones[rig.bones[:, 0]]
    for k in range(1, rig.bones.shape[1]):
        mixed += rig.weights[:, k, None] * bones[rig.bones[:, k]]
    moved = apply(mixed[:, :9].reshape(-1, 3, 3), shaped) + mixed[:, 9:]
    return moved + np.asarray(transl, np.float64), places + np.asarray(transl, np.float64)


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
    skin = model.skin
    kinematics = model.kinematics
    shapes = model.num_betas
    if len(skin.directions) > shapes + model.num_expression:
        raise ValueError(
            f"Worlds pose bodies without pose correctives: the {model.name} body has some."
        )
    weights = np.ascontiguousarray(skin.weights.double().numpy().T)
    most = int((weights > 0).sum(axis=1).max())
    bones = np.argsort(-weights, axis=1, kind="stable")[:, :most]
    count = weights.shape[1]
    parents = kinematics.parents.numpy()
    depth = np.zeros(count, np.int64)
    for joint in range(1, count):
        depth[joint] = depth[parents[joint]] + 1
    levels = [np.flatnonzero(depth == level) for level in range(1, int(depth.max()) + 1)]
    bind = (
        np.tile(np.eye(3), (count, 1, 1))
        if kinematics.bind_rot is None
        else kinematics.bind_rot.double().numpy()
    )
    return _Rig(
        template=np.ascontiguousarray(skin.template.double().numpy().T),
        directions=np.ascontiguousarray(
            skin.directions[:shapes].double().numpy().transpose(0, 2, 1)
        ),
        bones=bones,
        weights=np.take_along_axis(weights, bones, axis=1),
        joints=kinematics.template.double().numpy(),
        joint_directions=kinematics.directions[:shapes].double().numpy().reshape(shapes, count, 3),
        bind=bind,
        parents=parents,
        levels=tuple((joints, parents[joints]) for joints in levels),
    )
