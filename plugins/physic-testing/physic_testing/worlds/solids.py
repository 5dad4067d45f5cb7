"""Boxes and ground plane of a world: signed distance and mesh.

The room's frame (x right, y up, z towards the camera's side), metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.worlds.reproducible_math import apply, dot, matmul, norm, round_to_grid, sin_cos

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import FloatArray

__all__ = [
    "BLOCK_MATERIALS",
    "BOX_QUADS",
    "GROUND_MATERIALS",
    "LEVEL_GROUND",
    "Block",
    "Ground",
    "SolidDistances",
    "blocks_mesh",
    "box_corners",
    "signed_distance",
    "yaw_matrix",
]

BLOCK_MATERIALS = ("wood", "fabric", "metal", "stone", "plaster")
"""Materials of blocks."""

GROUND_MATERIALS = ("floor", "paving", "grass")
"""Materials of the ground."""

BOX_QUADS: NDArray[np.int64] = np.array(
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
)
"""Corner indices (6, 4) of a box's faces -x +x -y +y -z +z, counter-clockwise from outside.

Bits 0, 1 and 2 of a corner index are set where x, y and z are at their maximum.
"""

_CHUNK = 1 << 20  # points times blocks at once
_ROUND_STEPS = 4  # quads from the middle of a rounded side to its edge


@dataclass(frozen=True)
class Block:
    """A box with yaw and pitch; all its values are rounded to a grid.

    Attributes:
        centre: x, y, z of the centre, m.
        half: half extents along the box's axes, m.
        yaw: rotation about +y, radians.
        material: one of BLOCK_MATERIALS.
        pitch: rotation about the box's own +x before the yaw, radians; positive tips the top
            towards its own +z.
        surface: what the box is part of, one of ``physic_core.types.SURFACE_NAMES``.
        rounding: radius of the edges, m, at most the smallest half extent; a cube of this half
            extent is a ball.
        soft: depth by which the top gives way under a person, m; 0 for a rigid block. Only blocks
            without pitch and rounding give way.
        item: name of the small object that the block is part of, such as "ball"; "" for a block of
            the scene. Items belong to the photo of people, not to the empty scene.
    """

    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    yaw: float = 0.0
    material: str = "wood"
    pitch: float = 0.0
    surface: str = "object"
    rounding: float = 0.0
    soft: float = 0.0
    item: str = ""

    def __post_init__(self) -> None:
        """Round all numbers to a grid."""
        for name in ("centre", "half"):
            x, y, z = round_to_grid(np.array(getattr(self, name))).tolist()
            object.__setattr__(self, name, (x, y, z))
        for name in ("yaw", "pitch", "rounding", "soft"):
            object.__setattr__(self, name, float(round_to_grid(getattr(self, name))))

    @cached_property
    def rotation(self) -> FloatArray:
        """Rotation (3, 3) from the block's axes to the room's axes."""
        s, c = (float(part) for part in sin_cos(self.pitch))
        return matmul(yaw_matrix(self.yaw), np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]))

    def to_local(self, points: FloatArray) -> FloatArray:
        """Transform points (..., 3) from the room frame to the block's axes, with the origin at its
        centre.
        """
        return apply(self.rotation.T, points - np.array(self.centre))

    def corners(self) -> FloatArray:
        """Return the corners (8, 3) of the box before rounding, in the room frame."""
        half = np.array(self.half)
        corners: FloatArray = apply(self.rotation, box_corners(-half, half)) + np.array(self.centre)
        return corners

    def pressed(self) -> Block:
        """Return the block with its top lowered by ``soft``."""
        if not self.soft:
            return self
        x, y, z = self.centre
        a, b, c = self.half
        return replace(self, centre=(x, y - self.soft / 2, z), half=(a, b - self.soft / 2, c))


@dataclass(frozen=True)
class Ground:
    """Half-space below a plane through the origin.

    Attributes:
        normal: unit normal, upwards.
        material: one of GROUND_MATERIALS.
    """

    normal: tuple[float, float, float] = (0.0, 1.0, 0.0)
    material: str = "floor"

    def height_at(self, x: float, z: float) -> float:
        """Return the y coordinate of the ground at (x, z)."""
        return -(self.normal[0] * x + self.normal[2] * z) / self.normal[1]


LEVEL_GROUND = Ground()
"""Horizontal ground."""


class SolidDistances:
    """Blocks and ground, prepared for repeated distance queries.

    Args:
        blocks: may touch and overlap.
        ground: ground plane.
    """

    def __init__(self, blocks: Sequence[Block], ground: Ground) -> None:
        count = len(blocks)
        self._rotation = np.array([block.rotation for block in blocks]).reshape(count, 3, 3)
        self._centre = np.array([block.centre for block in blocks], np.float64).reshape(count, 3)
        self._rounding = np.array([block.rounding for block in blocks], np.float64)
        self._half = (
            np.array([block.half for block in blocks], np.float64).reshape(count, 3)
            - self._rounding[:, None]
        )
        self._normal = np.array(ground.normal, np.float64)

    def distances(self, points: FloatArray) -> FloatArray:
        """Return signed distances (b + 1, n) of points (n, 3) to the b blocks and the ground (last
        row).
        """
        found = np.empty((len(self._half) + 1, len(points)))
        found[-1] = dot(points, self._normal)
        if len(self._half):
            shifted = [points[:, i] - self._centre[:, i, None] for i in range(3)]
            turn = self._rotation[..., None]
            local = [
                shifted[0] * turn[:, 0, j] + shifted[1] * turn[:, 1, j] + shifted[2] * turn[:, 2, j]
                for j in range(3)
            ]
            x, y, z = (np.abs(local[j]) - self._half[:, j, None] for j in range(3))
            inside = np.minimum(np.maximum(np.maximum(x, y), z), 0)
            x, y, z = (np.maximum(beyond, 0) for beyond in (x, y, z))
            found[:-1] = np.sqrt(x * x + y * y + z * z) + inside - self._rounding[:, None]
        return found

    def normals(self, points: FloatArray, which: NDArray[np.int64]) -> FloatArray:
        """Return the distance gradients (n, 3) at points (n, 3), each for one row (n,) of
        :meth:`distances`.
        """
        normals = np.repeat(self._normal[None], len(points), axis=0)
        boxes = np.flatnonzero(which < len(self._half))
        if len(boxes):
            block = which[boxes]
            turn = self._rotation[block]
            local = apply(np.swapaxes(turn, 1, 2), points[boxes] - self._centre[block])
            beyond = np.abs(local) - self._half[block]
            away: FloatArray = np.maximum(beyond, 0)
            outside = away.max(axis=1) > 0
            deepest = np.eye(3)[beyond.argmax(axis=1)]
            direction = np.where(
                outside[:, None], away / np.maximum(norm(away), 1e-300)[:, None], deepest
            )
            normals[boxes] = apply(turn, np.where(local < 0, -direction, direction))
        return normals


def signed_distance(points: FloatArray, blocks: Sequence[Block], ground: Ground) -> FloatArray:
    """Return the signed distance of points (..., 3) to the union of blocks and ground; exact
    outside the solids.

    Inside it is the depth below the surface of the one thing in which the point lies deepest.

    Args:
        points: (..., 3), metres.
        blocks: may touch and overlap.
        ground: the ground.

    Returns:
        (...).
    """
    flat = np.asarray(points, np.float64).reshape(-1, 3)
    solid = SolidDistances(blocks, ground)
    step = max(1, _CHUNK // (len(blocks) + 1))
    found = [solid.distances(flat[i : i + step]).min(axis=0) for i in range(0, len(flat), step)]
    distance: FloatArray = np.concatenate([*found, np.zeros(0)]).reshape(np.shape(points)[:-1])
    return distance


def blocks_mesh(blocks: Sequence[Block]) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]:
    """Return the mesh of blocks.

    Returns:
        Vertices (V, 3), faces (F, 3), counter-clockwise from outside, and the side (F,) of each
        face: 6 i + k for side k of block i, in the order of BOX_QUADS.
    """
    vertices: list[FloatArray] = [np.zeros((0, 3))]
    faces: list[NDArray[np.int64]] = [np.zeros((0, 3), np.int64)]
    sides: list[NDArray[np.int64]] = [np.zeros(0, np.int64)]
    count = 0
    for i, block in enumerate(blocks):
        corners, quads, side = (
            _rounded_box(block) if block.rounding else (block.corners(), BOX_QUADS, np.arange(6))
        )
        vertices.append(corners)
        faces.append(
            np.stack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]], axis=1).reshape(-1, 3) + count
        )
        sides.append(np.repeat(6 * i + side, 2))
        count += len(corners)
    return np.concatenate(vertices), np.concatenate(faces), np.concatenate(sides)


def _rounded_box(block: Block) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]:
    """Return vertices (V, 3) in the room frame, quads (Q, 4) and the side (Q,) of each, of a box
    with round edges.
    """
    core = np.array(block.half) - block.rounding
    # Along each axis the round edges in steps of equal angle; between them the flat part as one
    # step.
    bend, _ = sin_cos(np.linspace(0, np.pi / 4, _ROUND_STEPS + 1))
    edge = bend / np.sqrt(1 - bend * bend)
    line = np.concatenate([-edge[::-1], edge])
    flat = np.repeat([-1.0, 1.0], len(edge))
    rows, columns = (index.reshape(-1) for index in np.mgrid[: len(line), : len(line)])
    i, j = (index.reshape(-1) for index in np.mgrid[: len(line) - 1, : len(line) - 1])
    first = i * len(line) + j
    grid = np.stack([first, first + len(line), first + len(line) + 1, first + 1], axis=1)
    vertices = []
    for quad in BOX_QUADS:
        a, b, _, d = box_corners(-np.ones(3), np.ones(3))[quad]
        middle = (b + d) / 2
        u = (b - a) / 2
        v = (d - a) / 2
        cube = middle + line[rows, None] * u + line[columns, None] * v
        inner = (middle + flat[rows, None] * u + flat[columns, None] * v) * core
        vertices.append(inner + block.rounding * cube / norm(cube)[:, None])
    quads = np.concatenate([grid + k * len(rows) for k in range(6)])
    places = np.concatenate(vertices)
    a, b, c, d = (places[quads[:, k]] for k in range(4))
    full = norm(np.cross(c - a, d - b)) > 0
    found: FloatArray = apply(block.rotation, places) + np.array(block.centre)
    return found, quads[full], np.repeat(np.arange(6), len(grid))[full]


@lru_cache(maxsize=1024)
def yaw_matrix(yaw: float) -> FloatArray:
    """Return the rotation matrix (3, 3) about +y by an angle in radians; read-only, as matrices are
    cached.
    """
    s, c = (float(part) for part in sin_cos(yaw))
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    turn.setflags(write=False)
    return turn


def box_corners(low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the corners (8, 3) of an axis-aligned box, in the order of BOX_QUADS."""
    bits = (np.arange(8)[:, None] >> np.array([0, 1, 2])) & 1
    return np.where(bits == 1, high, low).astype(np.float64)
