"""A room: floor, walls and block furniture, as a mesh, as an exact signed distance, and as colours.

The room's own frame: metres, x right, y up, z towards the camera's side, the floor at y = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray

__all__ = ["MATERIALS", "Block", "Room", "colours"]

MATERIALS = ("floor", "ceiling", "back_wall", "front_wall", "left_wall", "right_wall", "wood", "fabric")
"""Names of surfaces; faces carry an index into them."""

# Corner i of a box has x, y, z sign from its bits; each quad is counter-clockwise seen from outside.
_QUADS = np.array(
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
)  # -x +x -y +y -z +z


@dataclass(frozen=True)
class Block:
    """A box that stands anywhere, turned about the vertical.

    Attributes:
        centre: x, y, z of its middle.
        half: half its width, height and depth.
        yaw: radians, turn about +y.
        material: a name in MATERIALS.
    """

    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    yaw: float = 0.0
    material: str = "wood"

    def to_local(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) of the room in the block's own axes, origin in its middle."""
        local: FloatArray = (points - np.array(self.centre)) @ yaw_matrix(self.yaw)
        return local


@dataclass(frozen=True)
class Room:
    """A closed box of air with blocks in it.

    Attributes:
        low: x, y, z of the corner with the smallest coordinates; y = 0 is the floor.
        high: x, y, z of the opposite corner.
        blocks: furniture; blocks may touch.
        seed: of the colours.
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    blocks: tuple[Block, ...]
    seed: int = 0

    def mesh(self) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]:
        """Vertices (V, 3), faces (F, 3) counter-clockwise seen from the air, and each face's material (F,)."""
        corners = [_corners(np.array(self.low), np.array(self.high))]
        quads = [_QUADS[:, ::-1]]  # the room is seen from inside
        walls = ("left_wall", "right_wall", "floor", "ceiling", "back_wall", "front_wall")
        materials = [np.array([MATERIALS.index(name) for name in walls])]
        for i, block in enumerate(self.blocks, start=1):
            half = np.array(block.half)
            corners.append(_corners(-half, half) @ yaw_matrix(block.yaw).T + np.array(block.centre))
            quads.append(_QUADS + 8 * i)
            materials.append(np.full(6, MATERIALS.index(block.material)))
        joined = np.concatenate(quads)
        faces = np.stack([joined[:, [0, 1, 2]], joined[:, [0, 2, 3]]], axis=1).reshape(-1, 3)
        return np.concatenate(corners), faces.astype(np.int64), np.repeat(np.concatenate(materials), 2)

    def signed_distance(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) -> (...) metres to the nearest surface, exact in the air, negative inside anything solid."""
        below, above = points - np.array(self.low), np.array(self.high) - points
        distance: FloatArray = np.minimum(below, above).min(axis=-1)
        for block in self.blocks:
            distance = np.minimum(distance, _box_distance(block.to_local(points), np.array(block.half)))
        return distance


def yaw_matrix(yaw: float) -> FloatArray:
    """The (3, 3) rotation by ``yaw`` radians about +y."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _corners(low: FloatArray, high: FloatArray) -> FloatArray:
    bits = (np.arange(8)[:, None] >> np.array([0, 1, 2])) & 1
    return np.where(bits == 1, high, low).astype(np.float64)


def _box_distance(local: FloatArray, half: FloatArray) -> FloatArray:
    outside = np.abs(local) - half
    distance: FloatArray = np.linalg.norm(np.maximum(outside, 0), axis=-1) + np.minimum(outside.max(axis=-1), 0)
    return distance


def colours(room: Room, points: FloatArray, material: NDArray[Any]) -> FloatArray:
    """Albedo of surface points: planks, wallpaper, pictures on the walls, wood, cloth.

    Args:
        room: whose seed and size the patterns follow.
        points: (n, 3), in the room's frame.
        material: (n,) index into MATERIALS.

    Returns:
        (n, 3) in [0, 1].
    """
    x, y, z = points.T
    rng = np.random.default_rng(room.seed)
    tint = 1 + 0.1 * rng.uniform(-1, 1, (len(MATERIALS), 3))
    shade = np.ones(len(points))
    albedo = np.full((len(points), 3), 0.5)

    def paint(name: str, colour: tuple[float, float, float]) -> BoolArray:
        here: BoolArray = material == MATERIALS.index(name)
        albedo[here] = np.array(colour) * tint[MATERIALS.index(name)]
        return here

    floor = paint("floor", (0.62, 0.44, 0.28))
    shade[floor] = _planks(x[floor], z[floor], room.seed)
    paint("ceiling", (0.9, 0.9, 0.88))
    for name, along in (("back_wall", x), ("front_wall", x), ("left_wall", z), ("right_wall", z)):
        wall = paint(name, (0.75, 0.77, 0.70) if name.startswith(("back", "front")) else (0.62, 0.70, 0.76))
        shade[wall] = _wallpaper(along[wall], y[wall])
    back = material == MATERIALS.index("back_wall")
    for left, width, tone in ((-1.15, 0.7, (0.75, 0.35, 0.25)), (0.85, 0.5, (0.20, 0.42, 0.55))):
        albedo[back], shade[back] = _picture(x[back] - left, y[back] - 1.45, width, tone, albedo[back], shade[back])
    wood = paint("wood", (0.50, 0.32, 0.20))
    shade[wood] = 1 + 0.12 * np.sin(70 * x[wood] + 9 * np.sin(6 * z[wood])) * np.cos(11 * y[wood])
    fabric = paint("fabric", (0.36, 0.45, 0.38))
    shade[fabric] = 1 + 0.15 * np.sign(np.sin(90 * (x[fabric] + z[fabric])) * np.sin(90 * (y[fabric] + z[fabric])))
    return np.clip(albedo * shade[:, None], 0, 1)


def _planks(x: FloatArray, z: FloatArray, seed: int) -> FloatArray:
    """Boards 14 cm wide along z with dark joints, each of its own tone and grain."""
    row = np.floor(x / 0.14)
    along = z + 0.83 * np.mod(row * 0.618, 1.0)
    board = np.floor(along / 1.1)
    tone = np.mod(np.sin(row * 12.9898 + board * 78.233 + seed) * 43758.5453, 1.0)
    joint = (np.mod(x, 0.14) < 0.007) | (np.mod(along, 1.1) < 0.007)
    grain = np.sin(220 * x + 5 * np.sin(3 * z + 9 * tone)) * 0.05
    return np.where(joint, 0.45, 0.8 + 0.4 * tone + grain)


def _wallpaper(along: FloatArray, y: FloatArray) -> FloatArray:
    """Wide pale stripes over a dark skirting board."""
    stripes = 1 + 0.05 * np.sign(np.sin(2 * np.pi * along / 0.3)) + 0.02 * np.sin(31 * along) * np.sin(27 * y)
    return np.where(y < 0.1, 0.55, stripes)


def _picture(
    u: FloatArray, v: FloatArray, width: float, tone: tuple[float, float, float], albedo: FloatArray, shade: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """A framed picture, ``width`` wide, centred on (0, 0) of the wall."""
    frame = (np.abs(u) < width / 2) & (np.abs(v) < 0.4 * width)
    inside = (np.abs(u) < width / 2 - 0.04) & (np.abs(v) < 0.4 * width - 0.04)
    content = np.array(tone) * (1 + 0.5 * np.sin(9 * u / width) * np.cos(11 * v / width))[:, None]
    albedo = np.where(inside[:, None], content, np.where(frame[:, None], 0.18, albedo))
    return albedo, np.where(frame, 1.0, shade)
