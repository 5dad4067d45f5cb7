"""Solid things of the worlds: boxes that stand anywhere and the ground, their signed distance and their mesh.

The room's frame (x right, y up, z towards the camera's side), metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, overload

import numpy as np
import torch
from torch import Tensor

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import FloatArray

__all__ = [
    "BLOCK_MATERIALS",
    "FLAT",
    "GROUND_MATERIALS",
    "QUADS",
    "Block",
    "Ground",
    "Solid",
    "blocks_mesh",
    "box_corners",
    "signed_distance",
    "yaw_matrix",
]

BLOCK_MATERIALS = ("wood", "fabric", "metal", "stone", "plaster")
"""What blocks are made of."""

GROUND_MATERIALS = ("floor", "paving", "grass")
"""What grounds are made of."""

QUADS: NDArray[np.int64] = np.array(
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
)
"""(6, 4) corners of a box's faces -x +x -y +y -z +z, counter-clockwise seen from outside; corner i has the sign of x, y
and z from its bits."""

_CHUNK = 1 << 20  # points times blocks at once


@dataclass(frozen=True)
class Block:
    """A box that stands anywhere, turned about the vertical and tipped about its own width.

    Attributes:
        centre: x, y, z of its middle.
        half: half its width, height and depth.
        yaw: radians, turn about +y.
        material: one of BLOCK_MATERIALS.
        pitch: radians, turn about its own +x before the yaw: a positive one tips its top towards its own +z.
    """

    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    yaw: float = 0.0
    material: str = "wood"
    pitch: float = 0.0

    @property
    def rotation(self) -> FloatArray:
        """(3, 3), the block's axes to the room's."""
        c, s = np.cos(self.pitch), np.sin(self.pitch)
        turned: FloatArray = yaw_matrix(self.yaw) @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
        return turned

    def to_local(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) of the room in the block's own axes, origin in its middle."""
        local: FloatArray = (points - np.array(self.centre)) @ self.rotation
        return local

    def corners(self) -> FloatArray:
        """(8, 3) in the room."""
        half = np.array(self.half)
        turned: FloatArray = box_corners(-half, half) @ self.rotation.T + np.array(self.centre)
        return turned


@dataclass(frozen=True)
class Ground:
    """Everything below a plane through the origin.

    Attributes:
        normal: unit, upwards.
        material: one of GROUND_MATERIALS.
    """

    normal: tuple[float, float, float] = (0.0, 1.0, 0.0)
    material: str = "floor"

    def height_at(self, x: float, z: float) -> float:
        """The ground's y at a place."""
        return -(self.normal[0] * x + self.normal[2] * z) / self.normal[1]


FLAT = Ground()
"""A level floor."""


class Solid:
    """Blocks on the ground as tensors, for many evaluations of their signed distance.

    Args:
        blocks: may touch and overlap.
        ground: the ground.
        like: gives the float type and the device.
    """

    def __init__(self, blocks: Sequence[Block], ground: Ground, like: Tensor) -> None:
        def tensor(rows: Sequence[object], *shape: int) -> Tensor:
            return torch.as_tensor(np.array(rows, np.float64).reshape(shape), dtype=like.dtype, device=like.device)

        count = len(blocks)
        rotation = tensor([block.rotation for block in blocks], count, 3, 3)
        centre = tensor([block.centre for block in blocks], count, 1, 3)
        self._turns = rotation.permute(1, 0, 2).reshape(3, 3 * count)
        self._shift = (centre @ rotation).reshape(3 * count)
        self._half = tensor([block.half for block in blocks], count, 3)
        self._normal = tensor(ground.normal, 3)

    def distance(self, points: Tensor) -> Tensor:
        """Points (..., 3) -> (...) metres to the nearest surface, exact in the air, negative inside anything."""
        return self.distances(points).amin(-1)

    def distances(self, points: Tensor) -> Tensor:
        """Points (..., 3) -> (..., n + 1) metres to each of the n blocks, and to the ground last; negative inside."""
        height = (points @ self._normal)[..., None]
        if not len(self._half):
            return height
        # One matrix product turns all points into the axes of all blocks.
        local = (points @ self._turns - self._shift).reshape(*points.shape[:-1], len(self._half), 3)
        beyond = local.abs() - self._half
        squared = beyond.clamp(min=0).square().sum(-1)
        outside = squared > 0
        # The root is taken of positive numbers alone: inside, its gradient would not be a number.
        root = torch.where(outside, squared, torch.ones_like(squared)).sqrt()
        boxes = torch.where(outside, root, beyond.amax(-1).clamp(max=0))
        return torch.cat([boxes, height], -1)


@overload
def signed_distance(points: Tensor, blocks: Sequence[Block], ground: Ground) -> Tensor: ...
@overload
def signed_distance(points: FloatArray, blocks: Sequence[Block], ground: Ground) -> FloatArray: ...
def signed_distance(points: Tensor | FloatArray, blocks: Sequence[Block], ground: Ground) -> Tensor | FloatArray:
    """Distance to the union of blocks and ground: exact in the air, negative inside.

    Inside it is the depth below the surface of the one thing in which the point lies deepest.

    Args:
        points: (..., 3) tensor (differentiable) or array, metres.
        blocks: may touch and overlap.
        ground: the ground.

    Returns:
        (...) of the same kind.
    """
    if isinstance(points, Tensor):
        return Solid(blocks, ground, points).distance(points)
    flat = torch.from_numpy(np.ascontiguousarray(points, np.float64).reshape(-1, 3))
    solid = Solid(blocks, ground, flat)
    step = max(1, _CHUNK // (len(blocks) + 1))
    found = [solid.distance(part) for part in (flat[i : i + step] for i in range(0, len(flat), step))]
    distance: FloatArray = torch.cat([*found, flat.new_zeros(0)]).numpy().reshape(np.shape(points)[:-1])
    return distance


def blocks_mesh(blocks: Sequence[Block]) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]:
    """Vertices (8 n, 3), faces (12 n, 3) counter-clockwise seen from outside, and each face's block (12 n,)."""
    if not blocks:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
    quads = np.concatenate([QUADS + 8 * i for i in range(len(blocks))])
    faces = np.stack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]], axis=1).reshape(-1, 3)
    return np.concatenate([block.corners() for block in blocks]), faces, np.repeat(np.arange(len(blocks)), 12)


def yaw_matrix(yaw: float) -> FloatArray:
    """The (3, 3) rotation by ``yaw`` radians about +y."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def box_corners(low: FloatArray, high: FloatArray) -> FloatArray:
    """(8, 3) corners of the box between two opposite ones, in the order of QUADS."""
    bits = (np.arange(8)[:, None] >> np.array([0, 1, 2])) & 1
    return np.where(bits == 1, high, low).astype(np.float64)
