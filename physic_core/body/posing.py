"""Pose a few vertices, with a hand-written gradient for iterative fits.

Values are the same as with kinematics, skinning and autograd; the gradient takes a fifth of the operations. In world
coordinates, the gradient along the tree is two products with the descendant matrix.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from physic_core.body.kinematics import Kinematics
from physic_core.body.skinning import Skin


class JointTree:
    """Descendant and parent-child matrices of a joint tree.

    Attributes:
        kinematics: joints of a shape and their motion.
        family: (J, J), 1 where column d is row j or one of its descendants.
        incidence: (J, J), 1 at each joint itself and -1 at its parent: a bone as a difference of joints.
    """

    def __init__(self, kinematics: Kinematics) -> None:
        self.kinematics = kinematics
        parents, like = kinematics.parents, kinematics.template
        eye = torch.eye(len(parents), dtype=like.dtype, device=like.device)
        step = eye[parents].clone()
        step[0] = 0.0  # the root has no parent
        reach = eye
        for _ in range(len(kinematics.ancestors) + 1):
            # (1 + P)(1 + P^2)(1 + P^4)...: all powers of the step to the parent.
            reach = reach + step @ reach
            step = step @ step
        self.family = (reach.T > 0).to(like)
        self.incidence = eye - eye[parents] * (torch.arange(len(parents), device=like.device) > 0)[:, None]


def _across_joints(matrix: Tensor, values: Tensor) -> Tensor:
    """Return ``matrix @ values`` of each body, (J, J) and (B, J, k), by one product for all bodies."""
    batch, joints, columns = values.shape
    product = matrix @ values.transpose(0, 1).reshape(joints, batch * columns)
    return product.view(joints, batch, columns).transpose(0, 1)


def pose_vertices(
    tree: JointTree, skin: Skin, rotations: Tensor, coefficients: Tensor, transl: Tensor
) -> tuple[Tensor, Tensor]:
    """Pose the vertices and joints of B bodies; differentiable once, for rotations on SO(3).

    Args:
        tree: of the joints.
        skin: the n vertices to pose; directions beyond the coefficients are pose correctives.
        rotations: (B, J, 3, 3).
        coefficients: (B, D) of shape and expression.
        transl: (B, 3) metres.

    Returns:
        vertices (B, n, 3) and joints (B, J, 3), metres.
    """
    vertices, joints = _Pose.apply(rotations, coefficients, transl, tree, skin)  # type: ignore[no-untyped-call]
    return vertices, joints


class _Pose(torch.autograd.Function):
    """Autograd function of :func:`pose_vertices`."""

    @staticmethod
    def forward(
        ctx: Any, rotations: Tensor, coefficients: Tensor, transl: Tensor, tree: JointTree, skin: Skin
    ) -> tuple[Tensor, Tensor]:
        kinematics, batch, count = tree.kinematics, len(rotations), skin.num_vertices
        rest = kinematics.rest_joints(coefficients)
        world, skinning = kinematics.transforms(rotations, rest)
        shape = skin.with_correctives(coefficients, rotations)
        directions = skin.directions[: shape.shape[1]].flatten(1)
        # Homogeneous: the row of ones multiplies the bones' shifts.
        shaped = rest.new_ones(batch, 4, 1, count)
        shaped[:, :3, 0] = torch.addmm(skin.template.reshape(1, -1), shape, directions).view(batch, 3, count)
        joints = skinning.shape[1]
        columns = skin.blend(skinning.permute(0, 3, 2, 1).reshape(batch * 12, joints)).view(batch, 4, 3, count)
        vertices = columns[:, 3] + transl[..., None]
        for axis in range(3):
            vertices.addcmul_(columns[:, axis], shaped[:, axis])
        ctx.save_for_backward(rotations, rest, world, skinning, shaped, columns)
        ctx.model = tree, skin, coefficients.shape[1]
        return vertices.transpose(1, 2).contiguous(), world[..., 3] + transl[:, None]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        rotations, rest, world, skinning, shaped, columns = ctx.saved_tensors
        tree, skin, num_shape = ctx.model
        kinematics = tree.kinematics
        batch, joints = rotations.shape[:2]
        by_vertex, by_joint = gradients[0].transpose(1, 2).contiguous(), gradients[1]
        by_transl = by_vertex.sum(-1) + by_joint.sum(1)

        # Skinning: gradients of the bone motions (B, J, 3, 4) and of the shaped vertices.
        by_column = (by_vertex[:, None] * shaped).view(batch * 12, -1)
        by_skinning = skin.blend_gradient(by_column).reshape(batch, 4, 3, joints).permute(0, 3, 2, 1)
        by_shaped = columns[:, :3, 0] * by_vertex[:, :1]
        for axis in (1, 2):
            by_shaped.addcmul_(columns[:, :3, axis], by_vertex[:, axis, None])
        count = num_shape if len(skin.directions) <= num_shape else len(skin.directions)
        by_shape = by_shaped.flatten(1) @ skin.directions[:count].flatten(1).T

        # From bone motions about the origin of the bind pose to bone rotations and joint positions.
        turn, place = world[..., :3], world[..., 3]
        by_shift = by_skinning[..., 3]
        by_turn = by_skinning[..., :3] - by_shift[..., None] * rest[..., None, :]
        by_rest = -(by_shift[..., None, :] @ skinning[..., :3])[..., 0, :]
        if kinematics.bind_rot is not None:
            by_turn = by_turn @ kinematics.bind_rot.transpose(-1, -2)

        # Along the tree. With b_j the sum of gradients at j and its descendants, and C_j = dL/dG_j G_j^T,
        # C_j = S_j + sum over its children of C_c + b_c (p_c - p_j)^T.
        pull = _across_joints(tree.family, by_joint + by_shift)
        bones = place - place.index_select(1, kinematics.parents)
        own = by_turn @ turn.transpose(-1, -2)
        lever = pull[..., None] * bones[..., None, :]
        twist = _across_joints(tree.family, (own + lever).flatten(2)).reshape(own.shape) - lever
        upper = turn.index_select(1, kinematics.parents)
        upper = torch.cat([torch.eye(3, dtype=turn.dtype, device=turn.device).expand(batch, 1, 3, 3), upper[:, 1:]], 1)
        by_rotations = upper.transpose(-1, -2) @ twist @ turn

        by_offset = (pull[..., None, :] @ upper)[..., 0, :]
        if kinematics.bind_rot is not None:
            turned = by_offset[:, 1:, None] @ kinematics.bind_rot.index_select(0, kinematics.parents[1:])
            by_offset = torch.cat([by_offset[:, :1], turned[:, :, 0]], 1)
        by_rest = by_rest + _across_joints(tree.incidence.T, by_offset)
        by_coefficients = by_shape[:, :num_shape] + by_rest.flatten(1) @ kinematics.directions[:num_shape].T
        if count > num_shape:
            by_rotations[:, 1:] += by_shape[:, num_shape:].view(batch, joints - 1, 3, 3)
        return by_rotations, by_coefficients, by_transl, None, None
