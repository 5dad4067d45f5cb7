"""Random surroundings of an action: a furnished room, or an outdoor place.

Added objects intersect nobody, keep clear of the camera, and hide little of the people.
The room's frame (x right, y up, z towards the camera's side), metres.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.worlds import furniture
from physic_testing.worlds.reproducible_math import apply, norm
from physic_testing.worlds.rooms import Room, Walls
from physic_testing.worlds.solids import Block, Ground, yaw_matrix
from physic_testing.worlds.textures import Decoration, Patch

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from physic_core.types import BoolArray, FloatArray
    from physic_testing.worlds.cameras import CameraShot

__all__ = ["build_outdoor_place", "build_room", "hidden_by"]

_PEOPLE_CLEARANCE = 0.10  # m between people and what is added
_CAMERA_CLEARANCE = 0.45  # m between the camera and walls or what is added
_MAX_HIDDEN = 0.01  # share of a person's vertices that an added piece may hide
_MAX_HIDDEN_LEGS = 0.15  # the same of legs, where a piece may stand in front
_TALL = 1.6  # m; a block this high is a wall that the room lies along

# outdoors, by material; all others are walls
_SURFACES = {"hedge": "vegetation", "wood": "vegetation"}

Blocks = tuple[Block, ...]
Place = tuple[float, float]


class _FreeSpace:
    """Tests whether added furniture keeps clear of people, cameras and other furniture."""

    def __init__(
        self,
        people: FloatArray,
        blocks: Sequence[Block],
        shots: Sequence[CameraShot],
        rng: np.random.Generator,
    ) -> None:
        self.people = people
        self.positions = [shot.camera.position for shot in shots]
        self.taken = [_footprint((block,)) for block in blocks]
        # Now and then one piece may stand before somebody's legs.
        self._before_legs = rng.random() < 0.25
        middle = people[..., 1].mean(axis=1, keepdims=True)
        self._legs = people[..., 1] < middle

    def admit(self, blocks: Blocks) -> bool:
        """Return whether a piece fits; if it does, reserve its ground area."""
        footprint = _footprint(blocks)
        if any(_overlap(footprint, other) for other in self.taken):
            return False
        if min(distance_to(block, self.people).min() for block in blocks) < _PEOPLE_CLEARANCE:
            return False
        eyes = self.positions
        if (
            min(float(distance_to(block, eye)) for block in blocks for eye in eyes)
            < _CAMERA_CLEARANCE
        ):
            return False
        hidden = np.stack([hidden_by(blocks, eye, self.people) for eye in eyes])
        share = hidden.mean(axis=2).max(axis=0)
        legs_alone = not (hidden & ~self._legs).any()
        if (share > _MAX_HIDDEN).any():
            if not (self._before_legs and legs_alone and (share < _MAX_HIDDEN_LEGS).all()):
                return False
            self._before_legs = False
        self.taken.append(footprint)
        return True


def build_room(
    people: FloatArray,
    blocks: Blocks,
    shots: Sequence[CameraShot],
    rng: np.random.Generator,
    seed: int,
) -> Room:
    """Build a closed room with random furniture around an action.

    Args:
        people: (N, M, 3) points of the people.
        blocks: blocks of the action.
        shots: cameras; the first one has the photo of a world of one camera.
        rng: random generator.
        seed: seed of the colours.
    """
    walls = _walls(people, blocks, shots, rng)
    clear = _FreeSpace(people, blocks, shots, rng)
    added: list[Block] = []
    for _ in range(rng.integers(14, 26)):
        piece = _against_a_wall(walls, rng) if rng.random() < 0.7 else _free(people, walls, rng)
        if piece is not None and _inside(piece, walls) and clear.admit(piece):
            added += piece
    floor = Patch(
        str(rng.choice(["planks", "planks", "tiles", "carpet"])), seed, _rugs(people, walls, rng)
    )
    return Room(Ground(), (*blocks, *added), walls, floor, seed)


def build_outdoor_place(
    people: FloatArray,
    blocks: Blocks,
    ground: Ground,
    shots: Sequence[CameraShot],
    rng: np.random.Generator,
    seed: int,
) -> Room:
    """Build open ground with random benches, hedges, walls, trees and houses.

    Args:
        people: (N, M, 3) points of the people.
        blocks: blocks of the action.
        ground: ground plane, which may slope.
        shots: cameras; the first one has the photo of a world of one camera.
        rng: random generator.
        seed: seed of the colours.
    """
    clear = _FreeSpace(people, blocks, shots, rng)
    shot = shots[0]
    middle = people.reshape(-1, 3).mean(axis=0)
    position = shot.camera.position
    away = np.arctan2(middle[0] - position[0], middle[2] - position[2])
    half_field = np.arctan(shot.intrinsics.width / 2 / shot.intrinsics.fx)
    added: list[Block] = []
    far = (_hedge, _garden_wall, _house, _tree)
    near = (_bench, _railing, _tree, _hedge, _box)
    for i in range(rng.integers(16, 28)):
        kinds, reach = (far, (4.0, 30.0)) if i < 9 else (near, (1.0, 7.0))
        distance = float(
            np.hypot(*(middle - position)[[0, 2]])
            + reach[0] * (reach[1] / reach[0]) ** rng.random()
        )
        side = away + rng.uniform(-1.1, 1.1) * half_field
        place = (
            float(position[0] + distance * np.sin(side)),
            float(position[2] + distance * np.cos(side)),
        )
        make = kinds[rng.integers(len(kinds))]
        yaw = float(away + rng.choice([0.0, np.pi / 2]) + rng.normal(0, 0.3))
        piece = _lower_onto_ground(make(rng, place, yaw), ground)
        if clear.admit(piece):
            added += piece
    slanted = ground.normal[1] < 0.999
    kind = str(
        rng.choice(
            ["grass", "grass", "asphalt"] if slanted else ["grass", "paving", "asphalt", "paving"]
        )
    )
    return Room(ground, (*blocks, *added), None, Patch(kind, seed), seed)


def distance_to(block: Block, points: FloatArray) -> FloatArray:
    """Return the signed distance (...) of points (..., 3) to a block, negative inside."""
    outside = np.abs(block.to_local(points)) - np.array(block.half)
    distance: FloatArray = norm(np.maximum(outside, 0)) + np.minimum(outside.max(axis=-1), 0)
    return distance


def hidden_by(blocks: Sequence[Block], eye: FloatArray, points: FloatArray) -> BoolArray:
    """Return whether (...) a block intersects the segment from the eye (3,) to points (..., 3)."""
    hidden = np.zeros(points.shape[:-1], bool)
    for block in blocks:
        start = block.to_local(eye)
        end = block.to_local(points)
        along = end - start
        along = np.where(np.abs(along) < 1e-9, 1e-9, along)
        one = (-np.array(block.half) - start) / along
        two = (np.array(block.half) - start) / along
        enter = np.minimum(one, two).max(axis=-1)
        leave = np.maximum(one, two).min(axis=-1)
        hidden |= (enter < np.minimum(leave, 1.0)) & (leave > 0)
    return hidden


def _walls(
    people: FloatArray, blocks: Blocks, shots: Sequence[CameraShot], rng: np.random.Generator
) -> Walls:
    """Draw walls around people, blocks and cameras; a tall block of the action becomes part of a
    wall.
    """
    tall = [
        block
        for block in blocks
        if 2 * block.half[1] > _TALL and max(block.half[0], block.half[2]) > 0.5
    ]
    yaw = tall[0].yaw if tall else rng.uniform(-0.5, 0.5)
    turn = yaw_matrix(yaw)
    corners = [
        _wall_front(block).corners() if block in tall else block.corners() for block in blocks
    ]
    things = apply(turn.T, np.concatenate([people.reshape(-1, 3), *corners]))
    cameras = apply(turn.T, np.stack([shot.camera.position for shot in shots]))
    low = things.min(axis=0)
    high = things.max(axis=0)
    border = np.zeros((2, 2))
    for k, axis in enumerate((0, 2)):
        margins = np.array(
            [
                0.0 if _backs_onto(tall, turn, axis, side) else rng.uniform(0.25, 1.8)
                for side in (-1, 1)
            ]
        )
        border[k] = (
            min(low[axis] - margins[0], cameras[:, axis].min() - rng.uniform(0.5, 0.9)),
            max(high[axis] + margins[1], cameras[:, axis].max() + rng.uniform(0.5, 0.9)),
        )
    height = max(
        rng.uniform(2.4, 3.0),
        cameras[:, 1].max() + _CAMERA_CLEARANCE,
        float(people[..., 1].max()) + 0.25,
    )
    (x0, x1), (z0, z1) = border.tolist()
    walls = Walls((x0, z0), (x1, z1), float(height), float(yaw))
    return replace(walls, decorations=_decorations(walls, rng))


def _wall_front(block: Block) -> Block:
    """Return a tall block reduced to its front 3 cm, which protrude from the room's wall."""
    x, y, z = block.half
    normal = block.rotation[:, 2]
    centre = np.array(block.centre) + normal * (z - 0.015)
    return replace(
        block, centre=(float(centre[0]), float(centre[1]), float(centre[2])), half=(x, y, 0.015)
    )


def _backs_onto(tall: Sequence[Block], turn: FloatArray, axis: int, side: int) -> bool:
    """Return whether a tall block has its back to this side of the room."""
    return any(bool(apply(turn.T, block.rotation[:, 2])[axis] * side < -0.9) for block in tall)


def _decorations(walls: Walls, rng: np.random.Generator) -> tuple[tuple[Decoration, ...], ...]:
    """Draw pictures and windows for each wall."""
    sides = []
    for axis in (1, 1, 0, 0):
        low = walls.low[axis]
        high = walls.high[axis]
        found: list[Decoration] = []
        along = low + rng.uniform(0.2, 0.8)
        while along < high - 0.5:
            kind = str(rng.choice(["picture", "picture", "window"]))
            half = (
                (rng.uniform(0.15, 0.45), rng.uniform(0.15, 0.4))
                if kind == "picture"
                else (rng.uniform(0.4, 0.8), rng.uniform(0.45, 0.65))
            )
            if along + 2 * half[0] > high - 0.1:
                break
            level = rng.uniform(1.35, 1.75) if kind == "picture" else rng.uniform(1.4, 1.6)
            level = min(level, walls.height - half[1] - 0.1)
            found.append(
                Decoration(
                    kind, (float(along + half[0]), float(level)), half, int(rng.integers(1 << 30))
                )
            )
            along += 2 * half[0] + rng.uniform(0.2, 1.6)
        sides.append(tuple(found))
    return tuple(sides)


def _rugs(people: FloatArray, walls: Walls, rng: np.random.Generator) -> tuple[Decoration, ...]:
    """Draw up to one rug near the people."""
    if rng.random() < 0.4:
        return ()
    x, _, z = walls.to_local(people.reshape(-1, 3).mean(axis=0)) + rng.normal(0, 0.4, 3)
    return (
        Decoration(
            "rug",
            (float(x), float(z)),
            (rng.uniform(0.7, 1.4), rng.uniform(0.5, 1.1)),
            int(rng.integers(1 << 30)),
        ),
    )


def _against_a_wall(walls: Walls, rng: np.random.Generator) -> Blocks | None:
    """Draw a piece of furniture with its back to a wall."""
    makers: tuple[Callable[[np.random.Generator, Place, float], Blocks], ...] = (
        furniture.shelf,
        furniture.shelf,
        furniture.sofa,
        furniture.bed,
        furniture.table,
        furniture.bench,
        furniture.chair,
        furniture.counter,
    )
    make = makers[rng.integers(len(makers))]
    own = int(rng.integers(1 << 30))
    x0, _, z0, x1, _, _ = _extent(make(np.random.default_rng(own), (0.0, 0.0), 0.0))
    side = int(rng.integers(4))
    gap = rng.uniform(0.01, 0.06)
    turn = side * np.pi / 2  # facing +z, +x, -z, -x of the room
    low = np.array(walls.low)
    high = np.array(walls.high)
    length = (high - low)[side % 2]
    if length < (x1 - x0) + 0.1:
        return None
    along = rng.uniform(-x0 + 0.03, length - x1 - 0.03)
    back = -z0 + gap
    local = {
        0: (low[0] + along, low[1] + back),
        1: (low[0] + back, high[1] - along),
        2: (high[0] - along, high[1] - back),
        3: (high[0] - back, low[1] + along),
    }[side]
    x, _, z = apply(yaw_matrix(walls.yaw), np.array([local[0], 0.0, local[1]]))
    return make(np.random.default_rng(own), (float(x), float(z)), walls.yaw + turn)


def _free(people: FloatArray, walls: Walls, rng: np.random.Generator) -> Blocks:
    """Draw a chair, stool, table or bench near the people."""
    makers: tuple[Callable[[np.random.Generator, Place, float], Blocks], ...] = (
        furniture.chair,
        furniture.stool,
        furniture.table,
        furniture.bench,
    )
    make = makers[rng.integers(len(makers))]
    middle = people.reshape(-1, 3).mean(axis=0)
    angle = rng.uniform(-np.pi, np.pi)
    distance = rng.uniform(0.7, 2.2)
    place = (
        float(middle[0] + distance * np.sin(angle)),
        float(middle[2] + distance * np.cos(angle)),
    )
    return make(rng, place, float(rng.uniform(-np.pi, np.pi)))


def _inside(blocks: Blocks, walls: Walls) -> bool:
    """Return whether blocks are inside the walls."""
    corners = np.concatenate([block.corners() for block in blocks])
    return bool(walls.signed_distance(corners).min() > 0.005)


def _lower_onto_ground(blocks: Blocks, ground: Ground) -> Blocks:
    """Lower blocks onto sloping ground until no lower edge is above it."""
    corners = np.concatenate([block.corners() for block in blocks])
    base = corners[:, 1].min()
    feet = corners[corners[:, 1] < base + 0.05]
    lift = min(ground.height_at(float(x), float(z)) for x, _, z in feet) - base
    return tuple(
        replace(block, centre=(block.centre[0], block.centre[1] + lift, block.centre[2]))
        for block in blocks
    )


def _upright(
    place: Place, size: tuple[float, float, float], yaw: float, material: str, low: float = 0.0
) -> Block:
    """Return an upright box that stands at a place."""
    x, y, z = size
    surface = _SURFACES.get(material, "wall")
    return Block(
        (place[0], low + y / 2, place[1]), (x / 2, y / 2, z / 2), yaw, material, surface=surface
    )


def _hedge(rng: np.random.Generator, place: Place, yaw: float) -> Blocks:
    return (
        _upright(
            place, (rng.uniform(1.5, 9), rng.uniform(0.7, 2.2), rng.uniform(0.5, 1.0)), yaw, "hedge"
        ),
    )


def _garden_wall(rng: np.random.Generator, place: Place, yaw: float) -> Blocks:
    size = (rng.uniform(2, 9), rng.uniform(0.6, 2.4), rng.uniform(0.2, 0.4))
    material = str(rng.choice(["brick", "stone", "plaster"]))
    coping = (size[0] + 0.06, 0.06, size[2] + 0.06)
    return (_upright(place, size, yaw, material), _upright(place, coping, yaw, "stone", size[1]))


def _house(rng: np.random.Generator, place: Place, yaw: float) -> Blocks:
    """Return a house: walls with windows that protrude by 5 cm."""
    size = (rng.uniform(5, 12), rng.uniform(3, 9), rng.uniform(4, 8))
    body = _upright(place, size, yaw, str(rng.choice(["brick", "plaster", "stone"])))
    panes = []
    for storey in range(int(size[1] // 2.9)):
        for x in np.arange(-size[0] / 2 + 1.2, size[0] / 2 - 0.8, 2.2):
            panes += [
                Block(
                    (float(x), storey * 2.9 + 1.6, side * size[2] / 2),
                    (0.5, 0.65, 0.05),
                    material="metal",
                    surface="window",
                )
                for side in (-1, 1)
            ]
    return (body, *furniture.move_blocks(panes, place, yaw))


def _tree(rng: np.random.Generator, place: Place, yaw: float) -> Blocks:
    tall = rng.uniform(1.2, 2.4)
    thick = rng.uniform(0.15, 0.35)
    wide = rng.uniform(0.9, 2.2)
    trunk = _upright(place, (thick, tall + 0.4, thick), yaw, "wood")
    crown = [
        replace(
            _upright(
                place, (wide * s, wide * 0.8 * s, wide * s), yaw + turn, "hedge", tall + wide * lift
            ),
            pitch=tip,
        )
        for s, turn, tip, lift in (
            (1.0, 0.2, 0.2, 0.0),
            (0.85, 0.9, -0.3, 0.25),
            (0.6, 0.5, 0.4, 0.6),
        )
    ]
    return (trunk, *crown)


def _box(rng: np.random.Generator, place: Place, yaw: float) -> Blocks:
    size = (rng.uniform(0.4, 1.6), rng.uniform(0.35, 0.6), rng.uniform(0.4, 0.7))
    plants = (size[0] - 0.1, rng.uniform(0.15, 0.5), size[2] - 0.1)
    trough = replace(_upright(place, size, yaw, "stone"), surface="object")
    return (trough, _upright(place, plants, yaw, "hedge", size[1]))


def _bench(rng: np.random.Generator, place: Place, yaw: float) -> Blocks:
    return furniture.bench(rng, place, yaw)


def _railing(rng: np.random.Generator, place: Place, yaw: float) -> Blocks:
    return furniture.railing(rng, place, yaw)


def _extent(blocks: Blocks) -> FloatArray:
    """Return the bounding box of blocks: minimum and maximum corner."""
    corners = np.concatenate([block.corners() for block in blocks])
    return np.concatenate([corners.min(axis=0), corners.max(axis=0)])


def _footprint(blocks: Blocks) -> FloatArray:
    """Return the bounding box of blocks on the ground."""
    turn = yaw_matrix(blocks[0].yaw)
    local = apply(turn.T, np.concatenate([block.corners() for block in blocks]))
    (x0, _, z0), (x1, _, z1) = local.min(axis=0), local.max(axis=0)
    corners: FloatArray = apply(
        turn, np.array([[x0, 0, z0], [x1, 0, z0], [x1, 0, z1], [x0, 0, z1]])
    )[:, [0, 2]]
    return corners


def _overlap(one: FloatArray, two: FloatArray) -> bool:
    """Return whether two footprints overlap."""
    for corners in (one, two):
        for edge in (corners[1] - corners[0], corners[2] - corners[1]):
            a, b = (corner[:, 0] * edge[0] + corner[:, 1] * edge[1] for corner in (one, two))
            if a.max() <= b.min() or b.max() <= a.min():
                return False
    return True
