"""Furniture and buildings as blocks, with usual measures that vary by seed.

The room's frame (x right, y up, z towards the camera's side), metres. A piece stands with its middle at ``place``
(x, z) on level ground and looks along its own +z, which ``yaw`` turns about the vertical: who sits on a chair with
yaw 0 faces +z. Where a measure is not given it is drawn.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.worlds.reproducible_math import apply
from physic_testing.worlds.solids import Block, yaw_matrix

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = [
    "bed",
    "bench",
    "chair",
    "counter",
    "move_blocks",
    "railing",
    "shelf",
    "sofa",
    "stairs",
    "stool",
    "table",
    "wall",
]

Blocks = tuple[Block, ...]
Place = tuple[float, float]


def move_blocks(blocks: Iterable[Block], place: Place, yaw: float, lift: float = 0.0, surface: str = "") -> Blocks:
    """Rotate blocks about the vertical by ``yaw`` radians, then move them to (x, z) and up by ``lift``.

    With ``surface``, they become parts of such a surface.
    """
    turn = yaw_matrix(yaw)

    def carried(block: Block) -> Block:
        x, y, z = apply(turn, np.array(block.centre)) + np.array([place[0], lift, place[1]])
        name = surface or block.surface
        return replace(block, centre=(float(x), float(y), float(z)), yaw=block.yaw + yaw, surface=name)

    return tuple(carried(block) for block in blocks)


def chair(
    rng: np.random.Generator,
    place: Place = (0.0, 0.0),
    yaw: float = 0.0,
    *,
    height: float | None = None,
    width: float | None = None,
    depth: float | None = None,
    recline: float | None = None,
) -> Blocks:
    """Build a chair with four legs, a seat and a back.

    Args:
        rng: draws what is not given.
        place: of the seat's middle.
        yaw: radians.
        height: of the seat's top.
        width: of the seat.
        depth: of the seat.
        recline: radians by which the back tips backwards.
    """
    height = _drawn(rng, height, 0.43, 0.48)
    width, depth = _drawn(rng, width, 0.42, 0.50), _drawn(rng, depth, 0.40, 0.46)
    recline, tall = _drawn(rng, recline, 0.08, 0.22), float(rng.uniform(0.40, 0.52))
    cloth = "fabric" if rng.random() < 0.5 else "wood"
    legs = _legs(width - 0.03, depth - 0.03, height - 0.04, 0.035)
    seat = _slab((0, height - 0.02, 0), (width, 0.04, depth), cloth)
    # The back hinges at the rear edge of the seat, a hand's breadth over it.
    low = height + 0.06
    back = _tipped((0, low, -depth / 2 - 0.012), (width, tall, 0.024), recline, cloth)
    posts = [
        _tipped((x, height - 0.02, -depth / 2 - 0.012), (0.03, 0.10, 0.024), recline, "wood")
        for x in (-width / 2 + 0.03, width / 2 - 0.03)
    ]
    return move_blocks([*legs, seat, back, *posts], place, yaw, surface="seat")


def sofa(
    rng: np.random.Generator,
    place: Place = (0.0, 0.0),
    yaw: float = 0.0,
    *,
    width: float | None = None,
    height: float | None = None,
    depth: float | None = None,
    recline: float | None = None,
) -> Blocks:
    """Build a sofa; its blocks are the seat, the back and two arms, in this order.

    Args:
        rng: draws what is not given.
        place: of the seat's middle.
        yaw: radians.
        width: between the arms.
        height: of the seat's top.
        depth: of the seat before the back.
        recline: radians by which the back tips backwards.
    """
    width, height = _drawn(rng, width, 1.2, 2.0), _drawn(rng, height, 0.39, 0.45)
    depth, recline = _drawn(rng, depth, 0.50, 0.58), _drawn(rng, recline, 0.18, 0.34)
    tall, arm = float(rng.uniform(0.40, 0.52)), float(rng.uniform(0.12, 0.20))
    over = float(rng.uniform(0.14, 0.22))
    seat = _slab((0, height / 2, -0.05), (width, height, depth + 0.1), "fabric")
    back = _tipped((0, height - 0.06, -depth / 2 - 0.08), (width, tall + 0.06, 0.16), recline, "fabric")
    deep = depth + 0.22
    arms = [
        _slab(
            (side * (width + arm) / 2, (height + over) / 2, depth / 2 - deep / 2), (arm, height + over, deep), "fabric"
        )
        for side in (1, -1)
    ]
    return move_blocks([seat, back, *arms], place, yaw, surface="seat")


def stool(
    rng: np.random.Generator,
    place: Place = (0.0, 0.0),
    yaw: float = 0.0,
    *,
    height: float | None = None,
    width: float | None = None,
) -> Blocks:
    """Build a stool or pouffe; the seat is the last box of the list."""
    height, width = _drawn(rng, height, 0.40, 0.50), _drawn(rng, width, 0.34, 0.44)
    if rng.random() < 0.4:
        return move_blocks([_slab((0, height / 2, 0), (width, height, width), "fabric")], place, yaw, surface="seat")
    legs = _legs(width - 0.02, width - 0.02, height - 0.04, 0.04)
    return move_blocks([*legs, _slab((0, height - 0.02, 0), (width, 0.04, width), "wood")], place, yaw, surface="seat")


def bench(
    rng: np.random.Generator,
    place: Place = (0.0, 0.0),
    yaw: float = 0.0,
    *,
    width: float | None = None,
    height: float | None = None,
    depth: float | None = None,
    material: str = "wood",
) -> Blocks:
    """Build a bench without a back; the seat is the last box of the list."""
    width, height = _drawn(rng, width, 1.2, 1.8), _drawn(rng, height, 0.42, 0.48)
    depth = _drawn(rng, depth, 0.36, 0.44)
    thick = 0.05
    supports = [
        _slab((x, (height - thick) / 2, 0), (0.07, height - thick, depth - 0.08), material)
        for x in (-width / 2 + 0.2, width / 2 - 0.2)
    ]
    return move_blocks(
        [*supports, _slab((0, height - thick / 2, 0), (width, thick, depth), material)], place, yaw, surface="seat"
    )


def bed(
    rng: np.random.Generator,
    place: Place = (0.0, 0.0),
    yaw: float = 0.0,
    *,
    width: float | None = None,
    length: float | None = None,
    height: float | None = None,
    pillow: float | None = None,
) -> Blocks:
    """Build a bed with a headboard at -z and a pillow; the mattress is the first box of the list."""
    width, length = _drawn(rng, width, 1.0, 1.6), _drawn(rng, length, 2.0, 2.1)
    height, pillow = _drawn(rng, height, 0.40, 0.55), _drawn(rng, pillow, 0.07, 0.11)
    mattress = _slab((0, height - 0.10, 0), (width, 0.20, length), "fabric")
    frame = _slab((0, (height - 0.20) / 2 + 0.04, 0), (width - 0.08, height - 0.28, length - 0.08), "wood")
    head = _slab((0, 0.5, -length / 2 - 0.03), (width, 1.0, 0.05), "wood")
    cushion = _slab((0, height + pillow / 2, -length / 2 + 0.22), (min(0.7, width - 0.2), pillow, 0.40), "fabric")
    return move_blocks([mattress, frame, head, cushion], place, yaw, surface="bed")


def table(
    rng: np.random.Generator,
    place: Place = (0.0, 0.0),
    yaw: float = 0.0,
    *,
    width: float | None = None,
    depth: float | None = None,
    height: float | None = None,
    panel: bool = False,
) -> Blocks:
    """Build a table with the top as first box of the list; ``panel`` adds a front panel on the +z side."""
    width, depth = _drawn(rng, width, 1.0, 1.6), _drawn(rng, depth, 0.65, 0.85)
    height = _drawn(rng, height, 0.71, 0.77)
    top = _slab((0, height - 0.018, 0), (width, 0.036, depth), "wood")
    legs = _legs(width - 0.06, depth - 0.06, height - 0.036, 0.06)
    front = [_slab((0, height / 2, depth / 2 - 0.02), (width - 0.02, height - 0.05, 0.02), "wood")] if panel else []
    return move_blocks([top, *legs, *front], place, yaw, surface="table")


def counter(
    rng: np.random.Generator,
    place: Place = (0.0, 0.0),
    yaw: float = 0.0,
    *,
    width: float | None = None,
    depth: float | None = None,
    height: float | None = None,
) -> Blocks:
    """Build a closed cupboard with a worktop; the worktop is the first box of the list."""
    width, depth = _drawn(rng, width, 1.4, 2.2), _drawn(rng, depth, 0.45, 0.65)
    height = _drawn(rng, height, 0.88, 1.08)
    top = _slab((0, height - 0.02, 0), (width, 0.04, depth), "stone")
    return move_blocks(
        [top, _slab((0, (height - 0.04) / 2, 0), (width - 0.04, height - 0.04, depth - 0.06), "wood")],
        place,
        yaw,
        surface="cabinet",
    )


def stairs(
    rng: np.random.Generator,
    place: Place = (0.0, 0.0),
    yaw: float = 0.0,
    *,
    steps: int = 4,
    rise: float | None = None,
    going: float | None = None,
    width: float | None = None,
    material: str = "wood",
) -> Blocks:
    """Build steps that rise towards +z, the lowest first; the front edge of the lowest step is at ``place``."""
    rise, going = _drawn(rng, rise, 0.15, 0.19), _drawn(rng, going, 0.26, 0.32)
    width = _drawn(rng, width, 0.9, 1.3)
    long = steps * going
    risers = [
        _slab((0, (k + 0.5) * rise, (k * going + long) / 2), (width, rise, long - k * going), material)
        for k in range(steps)
    ]
    return move_blocks(risers, place, yaw, surface="stairs")


def shelf(
    rng: np.random.Generator,
    place: Place = (0.0, 0.0),
    yaw: float = 0.0,
    *,
    width: float | None = None,
    height: float | None = None,
) -> Blocks:
    """Build a shelf with sides, back, boards and some closed boxes."""
    width, height = _drawn(rng, width, 0.7, 1.1), _drawn(rng, height, 1.5, 2.0)
    depth, thick = float(rng.uniform(0.28, 0.36)), 0.025
    blocks = [_slab((s * (width - thick) / 2, height / 2, 0), (thick, height, depth), "wood") for s in (1, -1)]
    blocks.append(_slab((0, height / 2, -depth / 2 + 0.01), (width, height, 0.02), "wood"))
    count = int(height / 0.36)
    for k in range(count + 1):
        y = 0.06 + k * (height - 0.08) / count
        blocks.append(_slab((0, y, 0), (width, thick, depth), "wood"))
        if k < count and rng.random() < 0.6:
            wide, tall = float(rng.uniform(0.2, 0.45)), float(rng.uniform(0.14, 0.24))
            free = (width - wide) / 2 - thick
            x = float(rng.uniform(-free, free))
            blocks.append(_slab((x, y + (thick + tall) / 2, 0), (wide, tall, depth - 0.08), "fabric"))
    return move_blocks(blocks, place, yaw, surface="cabinet")


def wall(
    rng: np.random.Generator,
    place: Place = (0.0, 0.0),
    yaw: float = 0.0,
    *,
    width: float | None = None,
    height: float | None = None,
) -> Blocks:
    """Build a wall segment whose front face, towards +z, passes through ``place``."""
    width, height = _drawn(rng, width, 1.4, 2.6), _drawn(rng, height, 2.2, 2.6)
    return move_blocks([_slab((0, height / 2, -0.06), (width, height, 0.12), "plaster")], place, yaw, surface="wall")


def railing(
    rng: np.random.Generator,
    place: Place = (0.0, 0.0),
    yaw: float = 0.0,
    *,
    width: float | None = None,
    height: float | None = None,
) -> Blocks:
    """Build a handrail along x: the top rail is the first box of the list, then two lower rails and the posts."""
    width, height = _drawn(rng, width, 1.2, 2.0), _drawn(rng, height, 0.92, 1.08)
    count = max(2, round(width / 0.6) + 1)
    rails = [
        _slab((0, height - 0.025, 0), (width, 0.05, 0.06), "metal"),
        *(_slab((0, share * height, 0), (width, 0.03, 0.03), "metal") for share in (0.62, 0.3)),
    ]
    posts = [
        _slab((float(x), (height - 0.05) / 2, 0), (0.045, height - 0.05, 0.045), "metal")
        for x in np.linspace(-width / 2 + 0.03, width / 2 - 0.03, count)
    ]
    return move_blocks([*rails, *posts], place, yaw)


def _drawn(rng: np.random.Generator, given: float | None, low: float, high: float) -> float:
    """Return the given value, or a random one; the random number is drawn in both cases."""
    drawn = float(rng.uniform(low, high))
    return drawn if given is None else given


def _slab(centre: tuple[float, float, float], size: tuple[float, float, float], material: str) -> Block:
    """Return an axis-aligned box."""
    return Block(centre, (size[0] / 2, size[1] / 2, size[2] / 2), material=material)


def _tipped(foot: tuple[float, float, float], size: tuple[float, float, float], recline: float, material: str) -> Block:
    """Return a box that stands on ``foot`` and is tilted backwards about it."""
    half = size[1] / 2
    centre = (foot[0], foot[1] + half * np.cos(recline), foot[2] - half * np.sin(recline))
    return Block(
        (centre[0], float(centre[1]), float(centre[2])),
        (size[0] / 2, half, size[2] / 2),
        material=material,
        pitch=-recline,
    )


def _legs(width: float, depth: float, height: float, thick: float) -> list[Block]:
    """Return four table legs."""
    return [
        _slab((x * (width - thick) / 2, height / 2, z * (depth - thick) / 2), (thick, height, thick), "wood")
        for x in (-1, 1)
        for z in (-1, 1)
    ]
