"""Blend shapes and linear blend skinning of vertices."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

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

    Coordinates come before vertices in memory: every step then runs along contiguous rows, which halves the time.

    Attributes:
        template: (3, V) metres, bind pose.
        directions: (D, 3, V) change with one unit of each coefficient.
        weights: (J, V) skinning weights, each column sums to 1.
        blocks: the same weights, by blocks that follow each other; empty for products with all weights.
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
        """Return a copy for many products with the weights. Vertices near each other move with few of the joints."""
        blocks, first = [], 0
        for part in self.weights.tensor_split(_BLOCKS, dim=1):
            joints = part.any(1).nonzero(as_tuple=True)[0]
            blocks.append(WeightBlock(first, joints, part.index_select(0, joints)))
            first += part.shape[1]
        return replace(self, blocks=tuple(blocks))

    def blend(self, motions: Tensor) -> Tensor:
        """Return the weighted sums over joints: (m, J) -> (m, V); not differentiable."""
        if not self.blocks:
            return motions @ self.weights
        blended = motions.new_empty(len(motions), self.num_vertices)
        for block in self.blocks:
            torch.mm(motions.index_select(1, block.joints), block.weights, out=block.columns(blended))
        return blended

    def blend_gradient(self, gradient: Tensor) -> Tensor:
        """Return the gradient (m, J) of :meth:`blend` by the motions, from that by its result (m, V)."""
        if not self.blocks:
            return gradient @ self.weights.T
        total = gradient.new_zeros(len(self.weights), len(gradient))
        for block in self.blocks:
            total.index_add_(0, block.joints, block.weights @ block.columns(gradient).T)
        return total.T

    def with_correctives(self, shape: Tensor, rotations: Tensor) -> Tensor:
        """Append the coefficients of the pose correctives, if the skin has any, to those of the shape.

        Args:
            shape: (B, K) shape and expression.
            rotations: (B, J, 3, 3) of each joint relative to its parent.
        """
        if len(self.directions) <= shape.shape[1]:
            return shape
        identity = torch.eye(3, dtype=rotations.dtype, device=rotations.device)
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
        shaped = torch.addmm(self.template.reshape(1, -1), coefficients, self.directions[:count].flatten(1))
        shaped = shaped.view(batch, 3, 1, self.num_vertices)
        matrices = skinning.permute(0, 3, 2, 1).reshape(batch * 12, joints) @ self.weights
        column = matrices.view(batch, 4, 3, self.num_vertices)
        posed = column[:, 3]
        for axis in range(3):
            posed = torch.addcmul(posed, column[:, axis], shaped[:, axis])
        return posed.transpose(1, 2).contiguous()
