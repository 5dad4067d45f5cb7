"""How posed points move with the joints above them and with the shape, to second order.

Skinning is linear in the rotation matrix of each joint and in the shape. All derivatives follow
from sums over the bones below a joint.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch

from physic_core.body import parent_rotations

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.body import JointTree, Skin


@dataclass(frozen=True)
class PointMotions:
    """Motions of P points of B bodies, the J joints and then vertices, with the first n joints and
    K components of the shape; metres.

    Attributes:
        moments: (B, n, P, 3) the part of each point that a joint carries, about this joint. A
            rotation vector w on top of the joint's turn moves the point by w x moment.
        by_shape: (B, K, P, 3).
        world: (B, n, 3, 3) rotation of each bone against the T-pose.
        parents: (B, n, 3, 3) the same of each bone's parent.
    """

    moments: Tensor
    by_shape: Tensor
    world: Tensor
    parents: Tensor
    _family: Tensor
    _weights: Tensor
    _directions: Tensor
    _turns: Tensor
    _shifts: Tensor
    _places: Tensor

    def moments_by_shape(self, gradient: Tensor) -> Tensor:
        """Return the derivative (B, K, n, 3, 3) by the shape of the sum over points of gradient and
        moment, as outer products.

        Args:
            gradient: (B, P, 3).
        """
        batch = len(gradient)
        shapes = self._shifts.shape[1]
        pull = self._weights @ gradient  # (B, J, 3)
        outer = gradient[:, :, :, None] * self._directions.permute(2, 0, 1).flatten(1)[:, None]
        by_bone = (self._weights @ outer.flatten(2)).view(batch, -1, 3, shapes, 3)
        by_bone = by_bone.permute(0, 3, 1, 2, 4) @ self._turns[:, None].mT
        by_bone = by_bone + pull[:, None, :, :, None] * self._shifts[..., None, :]
        own = (self._family @ pull)[:, None, :, :, None] * self._places[..., None, :]
        below = (self._family @ by_bone.flatten(3)).view(batch, shapes, -1, 3, 3)
        return below - own


def point_motions(
    tree: JointTree, skin: Skin, rotations: Tensor, coefficients: Tensor, joints: int
) -> PointMotions:
    """Return how points move with the first ``joints`` joints and with the shape; not
    differentiable.

    Args:
        tree: of the joints.
        skin: the vertices, without pose correctives.
        rotations: (B, J, 3, 3) of each joint relative to its parent.
        coefficients: (B, K) of shape and expression.
        joints: n.
    """
    kinematics = tree.kinematics
    batch, shapes = coefficients.shape
    rest = kinematics.rest_joints(coefficients)
    world, skinning = kinematics.transforms(rotations, rest)
    total = rest.shape[1]
    turns = skinning[..., :3]
    # A joint is a point that its own bone carries.
    weights = torch.cat([torch.eye(total).to(rest), skin.weights], 1)
    family = tree.family[:joints]
    rest_by_shape = kinematics.directions[:shapes].view(shapes, total, 3)
    directions = torch.cat([rest_by_shape.mT, skin.directions[:shapes]], 2)  # (K, 3, P)
    shaped = torch.cat([rest.mT, _shaped_vertices(skin, coefficients)], 2)  # (B, 3, P)

    bones = (turns @ shaped[:, None] + skinning[..., 3:]) * weights[:, None]  # (B, J, 3, P)
    moments = (family @ bones.flatten(2)).view(batch, joints, 3, -1)
    moments = moments - world[:, :joints, :, 3, None] * (family @ weights)[:, None]

    position_slopes = _joints_by_shape(tree, turns, rest_by_shape)
    shifts = position_slopes - (turns[:, None] @ rest_by_shape[..., None])[..., 0]
    blended = (turns.flatten(2).mT @ weights).view(batch, 1, 3, 3, -1)
    by_shape = (blended * directions[:, None]).sum(3) + shifts.mT @ weights
    return PointMotions(
        moments.mT,
        by_shape.mT,
        world[:, :joints, :, :3],
        parent_rotations(world[..., :3], kinematics.parents[:joints]),
        family,
        weights,
        directions,
        turns,
        shifts,
        position_slopes[:, :, :joints],
    )


def _shaped_vertices(skin: Skin, coefficients: Tensor) -> Tensor:
    """Return the vertices (B, 3, V) of a shape in the bind pose."""
    directions = skin.directions[: coefficients.shape[1]].flatten(1)
    shaped = torch.addmm(skin.template.reshape(1, -1), coefficients, directions)
    return shaped.view(len(coefficients), 3, -1)


def _joints_by_shape(tree: JointTree, turns: Tensor, rest_by_shape: Tensor) -> Tensor:
    """Return the change (B, K, J, 3) of posed joints with the shape, from that at rest
    (K, J, 3).
    """
    steps = tree.incidence @ rest_by_shape  # of each bone
    above = parent_rotations(turns, tree.kinematics.parents)
    return tree.family.T @ (above[:, None] @ steps[..., None])[..., 0]
