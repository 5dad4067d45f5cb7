"""Forward kinematics of the 55-joint tree, linear blend skinning, and the pose of a few vertices.

The latter has a hand-written gradient for iterative fits. Values are the same as with kinematics,
skinning and autograd; the gradient takes a fifth of the operations. In world coordinates, the
gradient along the tree is two products with the descendant matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

_BLOCKS = 4  # of a skin; more would save less than their calls cost


@dataclass(frozen=True)
class WeightBlock:
    """Skinning weights of consecutive vertices, without the joints that move none of them.

    Attributes:
        first: index of the first vertex.
        joints: (k,) int64.
        weights: (k, m).
    """

    first: int
    joints: Tensor
    weights: Tensor

    def columns(self, of_vertices: Tensor) -> Tensor:
        """Return the columns (..., m) of these vertices from an array (..., V)."""
        return of_vertices.narrow(-1, self.first, self.weights.shape[1])


@dataclass(frozen=True)
class Skin:
    """Blend shapes and skinning weights of a set of vertices.

    Coordinates come before vertices in memory: every step then runs along contiguous rows, which
    halves the time.

    Attributes:
        template: (3, V) metres, bind pose.
        directions: (D, 3, V) change with one unit of each coefficient.
        weights: (J, V) skinning weights, each column sums to 1.
        blocks: the same weights, by blocks that follow each other; empty before :meth:`in_blocks`.
    """

    template: Tensor
    directions: Tensor
    weights: Tensor
    blocks: tuple[WeightBlock, ...] = ()

    @property
    def num_vertices(self) -> int:
        """Number of vertices."""
        return self.template.shape[1]

    def subset(self, vertex_ids: Tensor) -> Skin:
        """Return the skin of the vertices ``vertex_ids`` (n,) int64, in the order of the ids."""
        return Skin(
            self.template.index_select(1, vertex_ids),
            self.directions.index_select(2, vertex_ids),
            self.weights.index_select(1, vertex_ids),
        )

    def in_blocks(self) -> Skin:
        """Return a copy for many products with the weights.

        Vertices near each other move with few of the joints.
        """
        blocks = []
        first = 0
        for part in self.weights.tensor_split(_BLOCKS, dim=1):
            joints = part.any(1).nonzero(as_tuple=True)[0]
            blocks.append(WeightBlock(first, joints, part.index_select(0, joints)))
            first += part.shape[1]
        return replace(self, blocks=tuple(blocks))

    def blend(self, motions: Tensor) -> Tensor:
        """Return the weighted sums over joints, by :meth:`in_blocks`: (m, J) -> (m, V); not
        differentiable.
        """
        blended = motions.new_empty(len(motions), self.num_vertices)
        for block in self.blocks:
            torch.mm(
                motions.index_select(1, block.joints), block.weights, out=block.columns(blended)
            )
        return blended

    def blend_gradient(self, gradient: Tensor) -> Tensor:
        """Return the gradient (m, J) of :meth:`blend` by the motions, from that by its result (m,
        V).
        """
        total = gradient.new_zeros(len(self.weights), len(gradient))
        for block in self.blocks:
            total.index_add_(0, block.joints, block.weights @ block.columns(gradient).T)
        return total.T

    def with_correctives(self, shape: Tensor, rotations: Tensor) -> Tensor:
        """Append the coefficients of the pose correctives, if the skin has any, to those of the
        shape.

        Args:
            shape: (B, K) shape and expression.
            rotations: (B, J, 3, 3) of each joint relative to its parent.
        """
        if len(self.directions) <= shape.shape[1]:
            return shape
        identity = torch.eye(3, dtype=rotations.dtype)
        return torch.cat([shape, (rotations[:, 1:] - identity).flatten(1)], 1)

    def pose(self, coefficients: Tensor, skinning: Tensor) -> Tensor:
        """Apply blend shapes and linear blend skinning.

        Args:
            coefficients: (B, up to D), the leading rows of ``directions``.
            skinning: (B, J, 3, 4) rigid motion of each bone from the bind pose.

        Returns:
            vertices: (B, V, 3) metres.
        """
        batch, count = coefficients.shape
        joints = skinning.shape[1]
        shaped = torch.addmm(
            self.template.reshape(1, -1), coefficients, self.directions[:count].flatten(1)
        )
        shaped = shaped.view(batch, 3, 1, self.num_vertices)
        matrices = skinning.permute(0, 3, 2, 1).reshape(batch * 12, joints) @ self.weights
        column = matrices.view(batch, 4, 3, self.num_vertices)
        posed = column[:, 3]
        for axis in range(3):
            posed = torch.addcmul(posed, column[:, axis], shaped[:, axis])
        return posed.transpose(1, 2).contiguous()


@dataclass(frozen=True)
class Kinematics:
    """Rest joints as a linear function of the shape, and forward kinematics.

    Attributes:
        template: (J, 3) joints of the mean shape in the bind pose, metres.
        directions: (D, J * 3) derivative with respect to each shape (then expression) coefficient.
        bind_rot: (J, 3, 3) world rotation of each bone from the bind pose to the canonical T-pose;
            None if they are the same.
        ancestors: for each round of pointer doubling the (J + 1,) index of each joint's 2^k-th
            ancestor, J where there is none.
        parents: (J,) parent of each joint, the root its own.
    """

    template: Tensor
    directions: Tensor
    bind_rot: Tensor | None
    ancestors: tuple[Tensor, ...]
    parents: Tensor

    @classmethod
    def build(
        cls, template: Tensor, directions: Tensor, bind_rot: Tensor | None, parents: Sequence[int]
    ) -> Kinematics:
        """Build from mean joints (J, 3), shape directions (D, J, 3), bind rotations (J, 3, 3), J
        parents (root: -1).
        """
        none = len(parents)
        ancestor = [p if p >= 0 else none for p in parents] + [none]
        rounds = []
        while any(a != none for a in ancestor):
            rounds.append(torch.tensor(ancestor))
            ancestor = [ancestor[a] for a in ancestor]
        own_parent = torch.tensor([0, *parents[1:]])
        return cls(template, directions.flatten(1), bind_rot, tuple(rounds), own_parent)

    def rest_joints(self, coefficients: Tensor) -> Tensor:
        """Return the bind-pose joints (B, J, 3), metres, for shape coefficients (B, K), K <= D."""
        count = coefficients.shape[-1]
        flat = torch.addmm(self.template.reshape(1, -1), coefficients, self.directions[:count])
        return flat.view(-1, *self.template.shape)

    def transforms(self, rotations: Tensor, rest: Tensor) -> tuple[Tensor, Tensor]:
        """Compute the rigid motions of all bones for a pose.

        Pointer doubling: after round k every joint holds the product over its 2^k nearest
        ancestors, so the chain of 11 levels takes four batched products.

        Args:
            rotations: (B, J, 3, 3) of each joint relative to its parent, identity = canonical
                T-pose.
            rest: (B, J, 3) joints in the bind pose.

        Returns:
            world: (B, J, 3, 4) rotation of each bone against the T-pose, and position of its joint.
            skinning: (B, J, 3, 4) rigid motion from the bind pose to the posed body.
        """
        batch = len(rotations)
        offsets = torch.cat([rest[:, :1], rest[:, 1:] - rest.index_select(1, self.parents[1:])], 1)[
            ..., None
        ]
        if self.bind_rot is not None:
            turned = self.bind_rot.index_select(0, self.parents[1:]) @ offsets[:, 1:]
            offsets = torch.cat([offsets[:, :1], turned], 1)
        identity = torch.eye(4, dtype=rotations.dtype)
        bottom = identity[3:].expand(batch, len(self.parents), 1, 4)
        local = torch.cat([torch.cat([rotations, offsets], -1), bottom], -2)
        product = torch.cat([local, identity.expand(batch, 1, 4, 4)], 1)
        for ancestor in self.ancestors:
            product = product.index_select(1, ancestor) @ product
        world = product[:, :-1, :3]
        rotation = world[..., :3] if self.bind_rot is None else world[..., :3] @ self.bind_rot
        shift = world[..., 3:] - rotation @ rest[..., None]
        return world, torch.cat([rotation, shift], -1)


class JointTree:
    """Descendant and parent-child matrices of a joint tree.

    Attributes:
        kinematics: joints of a shape and their motion.
        family: (J, J), 1 where column d is row j or one of its descendants.
        incidence: (J, J), 1 at each joint itself and -1 at its parent: a bone as a difference of
            joints.
    """

    def __init__(self, kinematics: Kinematics) -> None:
        self.kinematics = kinematics
        parents = kinematics.parents
        like = kinematics.template
        eye = torch.eye(len(parents), dtype=like.dtype)
        step = eye[parents].clone()
        step[0] = 0.0  # the root has no parent
        reach = eye
        for _ in range(len(kinematics.ancestors) + 1):
            # (1 + P)(1 + P^2)(1 + P^4)...: all powers of the step to the parent.
            reach = reach + step @ reach
            step = step @ step
        self.family = (reach.T > 0).to(like)
        self.incidence = eye - eye[parents] * (torch.arange(len(parents)) > 0)[:, None]


def parent_rotations(turns: Tensor, parents: Tensor) -> Tensor:
    """Return the rotation (B, n, 3, 3) of the bone above each of n joints, identity for the root.

    Args:
        turns: (B, J, 3, 3) of all bones.
        parents: (n,) of the first n joints.
    """
    above = turns.index_select(1, parents)
    above[:, 0] = torch.eye(3, dtype=turns.dtype)
    return above


def _multiply_joints(matrix: Tensor, values: Tensor) -> Tensor:
    """Return ``matrix @ values`` of each body, (J, J) and (B, J, k), by one product for all
    bodies.
    """
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
        ctx: Any,
        rotations: Tensor,
        coefficients: Tensor,
        transl: Tensor,
        tree: JointTree,
        skin: Skin,
    ) -> tuple[Tensor, Tensor]:
        kinematics = tree.kinematics
        batch = len(rotations)
        count = skin.num_vertices
        rest = kinematics.rest_joints(coefficients)
        world, skinning = kinematics.transforms(rotations, rest)
        shape = skin.with_correctives(coefficients, rotations)
        directions = skin.directions[: shape.shape[1]].flatten(1)
        # Homogeneous: the row of ones multiplies the bones' shifts.
        shaped = rest.new_ones(batch, 4, 1, count)
        shaped[:, :3, 0] = torch.addmm(skin.template.reshape(1, -1), shape, directions).view(
            batch, 3, count
        )
        joints = skinning.shape[1]
        columns = skin.blend(skinning.permute(0, 3, 2, 1).reshape(batch * 12, joints)).view(
            batch, 4, 3, count
        )
        vertices = columns[:, 3] + transl[..., None]
        for axis in range(3):
            vertices.addcmul_(columns[:, axis], shaped[:, axis])
        ctx.save_for_backward(rest, world, skinning, shaped, columns)
        ctx.model = tree, skin, coefficients.shape[1]
        return vertices.transpose(1, 2).contiguous(), world[..., 3] + transl[:, None]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        rest, world, skinning, shaped, columns = ctx.saved_tensors
        tree, skin, num_shape = ctx.model
        kinematics = tree.kinematics
        by_vertex = gradients[0].transpose(1, 2).contiguous()
        by_joint = gradients[1]
        by_transl = by_vertex.sum(-1) + by_joint.sum(1)
        by_skinning, by_shape = _skin_gradients(skin, by_vertex, shaped, columns)

        # From bone motions about the origin of the bind pose to bone rotations and joint positions.
        by_shift = by_skinning[..., 3]
        by_turn = by_skinning[..., :3] - by_shift[..., None] * rest[..., None, :]
        by_rest = -(by_shift[..., None, :] @ skinning[..., :3])[..., 0, :]
        if kinematics.bind_rot is not None:
            by_turn = by_turn @ kinematics.bind_rot.transpose(-1, -2)
        by_rotations, by_bones = _tree_gradients(tree, world, by_turn, by_joint + by_shift)
        by_rest = by_rest + by_bones
        by_coefficients = (
            by_shape[:, :num_shape] + by_rest.flatten(1) @ kinematics.directions[:num_shape].T
        )
        if by_shape.shape[1] > num_shape:
            by_rotations[:, 1:] += by_shape[:, num_shape:].view_as(by_rotations[:, 1:])
        return by_rotations, by_coefficients, by_transl, None, None


def _skin_gradients(
    skin: Skin, by_vertex: Tensor, shaped: Tensor, columns: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the gradients of the bone motions (B, J, 3, 4) and of all coefficients (B, D), from
    that of the posed vertices (B, 3, V).
    """
    batch = len(by_vertex)
    by_column = (by_vertex[:, None] * shaped).view(batch * 12, -1)
    by_skinning = skin.blend_gradient(by_column).reshape(batch, 4, 3, -1).permute(0, 3, 2, 1)
    by_shaped = columns[:, :3, 0] * by_vertex[:, :1]
    for axis in (1, 2):
        by_shaped.addcmul_(columns[:, :3, axis], by_vertex[:, axis, None])
    return by_skinning, by_shaped.flatten(1) @ skin.directions.flatten(1).T


def _tree_gradients(
    tree: JointTree, world: Tensor, by_turn: Tensor, by_place: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the gradients of the rotations (B, J, 3, 3) and of the joints at rest (B, J, 3), from
    those of the bones' rotations and places in the pose.

    With b_j the sum of gradients at j and its descendants, and C_j = dL/dG_j G_j^T, C_j = S_j + sum
    over its children of C_c + b_c (p_c - p_j)^T.
    """
    kinematics = tree.kinematics
    turn = world[..., :3]
    positions = world[..., 3]
    pull = _multiply_joints(tree.family, by_place)
    bones = positions - positions.index_select(1, kinematics.parents)
    rotation_gradient = by_turn @ turn.transpose(-1, -2)
    lever = pull[..., None] * bones[..., None, :]
    twist = (
        _multiply_joints(tree.family, (rotation_gradient + lever).flatten(2)).reshape(
            rotation_gradient.shape
        )
        - lever
    )
    upper = parent_rotations(turn, kinematics.parents)
    by_offset = (pull[..., None, :] @ upper)[..., 0, :]
    if kinematics.bind_rot is not None:
        turned = by_offset[:, 1:, None] @ kinematics.bind_rot.index_select(
            0, kinematics.parents[1:]
        )
        by_offset = torch.cat([by_offset[:, :1], turned[:, :, 0]], 1)
    by_rotations = upper.transpose(-1, -2) @ twist @ turn
    return by_rotations, _multiply_joints(tree.incidence.T, by_offset)
