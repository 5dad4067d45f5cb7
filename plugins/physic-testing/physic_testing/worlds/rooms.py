"""A furnished room or open ground: mesh, exact signed distance and surface colours.

The room's own frame: metres, x right, y up, z towards the camera's side, the ground through the
origin.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.types import SURFACE_NAMES
from physic_testing.worlds.dents import Dent, dented_distance, dented_mesh
from physic_testing.worlds.reproducible_math import apply
from physic_testing.worlds.solids import (
    BOX_QUADS,
    Block,
    Ground,
    SolidDistances,
    blocks_mesh,
    box_corners,
    signed_distance,
    yaw_matrix,
)
from physic_testing.worlds.textures import Decoration, Patch, albedo

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import FloatArray

__all__ = ["Room", "SurfaceColours", "Walls"]

_HORIZON = 150.0  # m to where open ground ends


@dataclass(frozen=True)
class Walls:
    """Four walls and a ceiling above a level floor.

    Attributes:
        low: minimum x and z in the walls' own axes, m.
        high: maximum x and z, m.
        height: height of the ceiling, m.
        yaw: rotation of the walls about +y, radians.
        decorations: decorations of the left (-x), right (+x), back (-z) and front (+z) wall; u is
            along x or z, v up.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    height: float
    yaw: float = 0.0
    decorations: tuple[tuple[Decoration, ...], ...] = ((), (), (), ())

    def to_local(self, points: FloatArray) -> FloatArray:
        """Rotate points (..., 3) from the room frame to the walls' axes."""
        return apply(yaw_matrix(self.yaw).T, points)

    def signed_distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance (...) of points (..., 3) to the nearest wall or ceiling,
        negative outside.
        """
        local = self.to_local(points)
        across = np.minimum(
            local[..., [0, 2]] - np.array(self.low), np.array(self.high) - local[..., [0, 2]]
        )
        distance: FloatArray = np.minimum(across.min(axis=-1), self.height - local[..., 1])
        return distance


@dataclass(frozen=True)
class Room:
    """A closed room, or open ground if ``walls`` is None, with blocks.

    Attributes:
        ground: ground plane; level in a room with walls.
        blocks: furniture and other boxes; they may touch.
        walls: walls and ceiling; None outdoors.
        floor: material of the ground, with its rugs.
        seed: seed of the colours.
        dents: dents of soft blocks under people.
    """

    ground: Ground
    blocks: tuple[Block, ...]
    walls: Walls | None
    floor: Patch
    seed: int = 0
    dents: tuple[Dent, ...] = ()

    @property
    def items(self) -> tuple[str, ...]:
        """Names of the small objects in people's hands and on their laps."""
        return tuple(dict.fromkeys(block.item for block in self.blocks if block.item))

    def signed_distance(self, points: FloatArray, *, dented: bool = True) -> FloatArray:
        """Return the signed distance (...) of points (..., 3) to the nearest surface, negative
        inside solids.

        Small objects are not a surface of the room. Soft blocks have their dents, unless ``dented``
        is False.
        """
        bent = {dent.block: dent for dent in self.dents} if dented else {}
        rigid = [block for i, block in enumerate(self.blocks) if not block.item and i not in bent]
        distance = signed_distance(points, rigid, self.ground)
        flat = np.asarray(points, np.float64).reshape(-1, 3)
        for i, dent in bent.items():
            to_dent = dented_distance(self.blocks[i], dent.depth, flat).reshape(distance.shape)
            distance = np.minimum(distance, to_dent)
        return (
            distance
            if self.walls is None
            else np.minimum(distance, self.walls.signed_distance(points))
        )

    def nearest_surface(self, points: FloatArray) -> NDArray[np.uint8]:
        """Return the surface nearest to each point (n, 3): (n,), index into
        ``physic_core.types.SURFACE_NAMES``.
        """
        names = self.surface_names()
        scene = [i for i, block in enumerate(self.blocks) if not block.item]
        distance = SolidDistances([self.blocks[i].pressed() for i in scene], self.ground).distances(
            points
        )
        number = np.array([*(i + 6 for i in scene), 0])[distance.argmin(axis=0)]
        if self.walls is not None:
            local = self.walls.to_local(points)
            beside = self.walls.signed_distance(points)
            number = np.where(beside < distance.min(axis=0), 1, number)
            number = np.where(
                (number == 1) & (self.walls.height - local[:, 1] <= beside), 5, number
            )
        lookup = np.array([SURFACE_NAMES.index(name) for name in names], np.uint8)
        found: NDArray[np.uint8] = lookup[number]
        return found

    def surface_names(self) -> tuple[str, ...]:
        """Return the name of the ground, four walls, the ceiling and each block, in this order."""
        ground = "floor" if self.walls is not None else "ground"
        return (
            ground,
            "wall",
            "wall",
            "wall",
            "wall",
            "ceiling",
            *(block.surface for block in self.blocks),
        )

    def surface_normals(self, points: FloatArray) -> FloatArray:
        """Return the normal (n, 3) of the surface nearest to each of n points; of undented
        blocks.
        """
        blocks = [block for block in self.blocks if not block.item]
        solid = SolidDistances([block.pressed() for block in blocks], self.ground)
        distance = solid.distances(points)
        normals = solid.normals(points, distance.argmin(axis=0))
        if self.walls is not None:
            # Beside a wall the normal is level: the exact direction is of no use.
            wall = self.walls.signed_distance(points) < distance.min(axis=0)
            normals[wall] = apply(yaw_matrix(self.walls.yaw), np.array([1.0, 0.0, 0.0]))
        return normals

    def mesh(
        self, *, occupied: bool = False
    ) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]:
        """Return vertices (V, 3), faces (F, 3), counter-clockwise from the air side, and surface
        index (F,) per face.

        Surface 0 is the ground, 1 to 5 are left, right, back, front wall and ceiling, 6 + 6 i + k
        is side k of block i, in the order of ``solids.BOX_QUADS``. With ``occupied`` the mesh has
        dents and small objects, as in the photo of the people; without it has neither.
        """
        vertices, faces, side = self._blocks_mesh(occupied=occupied)
        if self.walls is None:
            shell = _ground_corners(self.ground)
            quads = np.array([[0, 1, 2, 3]])
            outer = np.array([0])
        else:
            walls = self.walls
            low = np.array([walls.low[0], 0.0, walls.low[1]])
            high = np.array([walls.high[0], walls.height, walls.high[1]])
            shell = apply(yaw_matrix(walls.yaw), box_corners(low, high))
            # seen from inside
            quads = BOX_QUADS[:, ::-1]
            outer = np.array([1, 2, 0, 5, 3, 4])
        inner = np.stack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]], axis=1).reshape(-1, 3)
        return (
            np.concatenate([shell, vertices]),
            np.concatenate([inner, faces + len(shell)]),
            np.concatenate([np.repeat(outer, 2), 6 + side]),
        )

    def _blocks_mesh(
        self, *, occupied: bool
    ) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]:
        """Return vertices, faces and sides of all blocks, in the order of the blocks."""
        bent = {dent.block: dent for dent in self.dents} if occupied else {}
        parts = []
        count = 0
        for i, block in enumerate(self.blocks):
            if block.item and not occupied:
                continue
            vertices, faces, side = (
                dented_mesh(block, bent[i].depth) if i in bent else blocks_mesh((block,))
            )
            parts.append((vertices, faces + count, side + 6 * i))
            count += len(vertices)
        vertices, faces, side = (
            np.concatenate(part) for part in zip(blocks_mesh(()), *parts, strict=True)
        )
        return vertices, faces, side


class SurfaceColours:
    """Colours of a room's surfaces, numbered as in ``Room.mesh``."""

    def __init__(self, room: Room) -> None:
        self._room = room
        rng = np.random.default_rng([room.seed, 11])
        self._wall_seeds = rng.integers(0, 1 << 30, 2)  # walls of one room are often of two colours
        self._person_ids = _block_seeds(room.blocks, room.seed)

    def albedo(
        self, points: FloatArray, surface: NDArray[np.int64], blur: FloatArray
    ) -> FloatArray:
        """Return the colours (n, 3) of points (n, 3) on surfaces (n,), with pixel footprint
        ``blur`` (n,) in metres.
        """
        colours = np.zeros((len(points), 3))
        order = np.argsort(surface, kind="stable")
        numbers, starts = np.unique(surface[order], return_index=True)
        for number, here in zip(numbers, np.split(order, starts[1:]), strict=True):
            patch, u, v = self._patch(int(number), points[here])
            colours[here] = albedo(patch, u, v, blur[here])
        return colours

    def _patch(self, surface: int, points: FloatArray) -> tuple[Patch, FloatArray, FloatArray]:
        """Return the material of a surface and the texture coordinates u, v (n,) of its points."""
        room = self._room
        if surface == 0 and room.walls is None:
            return room.floor, points[:, 0], points[:, 2]
        if surface < 6:
            assert room.walls is not None
            x, y, z = room.walls.to_local(points).T
            if surface == 0:
                return room.floor, x, z
            if surface == 5:
                return Patch("ceiling", room.seed), x, z
            seed = int(self._wall_seeds[0 if surface < 4 else 1])
            return (
                Patch("wall", seed, room.walls.decorations[surface - 1]),
                (z if surface < 3 else x),
                y,
            )
        index, side = divmod(surface - 6, 6)
        block = room.blocks[index]
        local = block.to_local(points)
        half = np.array(block.half)
        u, v = ([2, 1], [0, 2], [0, 1])[side // 2]
        if block.material in ("wood", "metal") and half[v] > half[u]:
            u, v = v, u  # grain runs along the board
        return Patch(block.material, self._person_ids[index]), local[:, u] + 3.1 * side, local[:, v]


def _block_seeds(blocks: tuple[Block, ...], seed: int) -> list[int]:
    """Return a colour seed per block; blocks of one material whose bounding boxes are within 5 cm
    share it.
    """
    seeds = [seed + 101 * i for i in range(len(blocks))]
    corners = np.array([block.corners() for block in blocks]).reshape(-1, 8, 3)
    low = corners.min(axis=1)
    high = corners.max(axis=1) + 0.05
    beside = ((low[:, None] < high) & (low < high[:, None])).all(axis=2)
    for i, block in enumerate(blocks):
        for j in range(i):
            if blocks[j].material == block.material and beside[i, j]:
                seeds[i] = seeds[j]
                break
    return seeds


def _ground_corners(ground: Ground) -> FloatArray:
    """Return the corners of the open ground's quad."""
    corners = [
        (-_HORIZON, -_HORIZON),
        (-_HORIZON, _HORIZON),
        (_HORIZON, _HORIZON),
        (_HORIZON, -_HORIZON),
    ]
    return np.array([(x, ground.height_at(x, z), z) for x, z in corners])
