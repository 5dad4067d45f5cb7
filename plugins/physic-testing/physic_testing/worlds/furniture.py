"""Furniture and buildings as blocks, with usual measures that vary by seed.

The room's frame (x right, y up, z towards the camera's side), metres. A piece stands with its
middle at ``place`` (x, z) on level ground and looks along its own +z, which ``yaw`` turns about the
vertical: who sits on a chair with yaw 0 faces +z.
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
    "stool",
    "table",
]

Blocks = tuple[Block, ...]
Place = tuple[float, float]


def move_blocks(blocks: Iterable[Block], place: Place, yaw: float, surface: str = "") -> Blocks:
    """Rotate blocks about the vertical by ``yaw`` radians, then move them to (x, z).

    With ``surface``, they become parts of such a surface.
    """
    turn = yaw_matrix(yaw)

    def carried(block: Block) -> Block:
        x, y, z = apply(turn, np.array(block.centre)) + np.array([place[0], 0.0, place[1]])
        name = surface or block.surface
        return replace(
            block, centre=(float(x), float(y), float(z)), yaw=block.yaw + yaw, surface=name
        )

    return tuple(carried(block) for block in blocks)


def chair(rng: np.random.Generator, place: Place, yaw: float) -> Blocks:
    """Build a chair with four legs, a seat and a back."""
    height = rng.uniform(0.43, 0.48)
    width = rng.uniform(0.42, 0.50)
    depth = rng.uniform(0.40, 0.46)
    recline = rng.uniform(0.08, 0.22)
    tall = float(rng.uniform(0.40, 0.52))
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


def sofa(rng: np.random.Generator, place: Place, yaw: float) -> Blocks:
    """Build a sofa."""
    width = rng.uniform(1.2, 2.0)
    height = rng.uniform(0.39, 0.45)
    depth = rng.uniform(0.50, 0.58)
    recline = rng.uniform(0.18, 0.34)
    tall = float(rng.uniform(0.40, 0.52))
    arm = float(rng.uniform(0.12, 0.20))
    over = float(rng.uniform(0.14, 0.22))
    seat = _slab((0, height / 2, -0.05), (width, height, depth + 0.1), "fabric")
    back = _tipped(
        (0, height - 0.06, -depth / 2 - 0.08), (width, tall + 0.06, 0.16), recline, "fabric"
    )
    deep = depth + 0.22
    arms = [
        _slab(
            (side * (width + arm) / 2, (height + over) / 2, depth / 2 - deep / 2),
            (arm, height + over, deep),
            "fabric",
        )
        for side in (1, -1)
    ]
    return move_blocks([seat, back, *arms], place, yaw, surface="seat")


def stool(rng: np.random.Generator, place: Place, yaw: float) -> Blocks:
    """Build a stool or pouffe."""
    height = rng.uniform(0.40, 0.50)
    width = rng.uniform(0.34, 0.44)
    if rng.random() < 0.4:
        return move_blocks(
            [_slab((0, height / 2, 0), (width, height, width), "fabric")],
            place,
            yaw,
            surface="seat",
        )
    legs = _legs(width - 0.02, width - 0.02, height - 0.04, 0.04)
    return move_blocks(
        [*legs, _slab((0, height - 0.02, 0), (width, 0.04, width), "wood")],
        place,
        yaw,
        surface="seat",
    )


def bench(rng: np.random.Generator, place: Place, yaw: float) -> Blocks:
    """Build a bench without a back."""
    width = rng.uniform(1.2, 1.8)
    height = rng.uniform(0.42, 0.48)
    depth = rng.uniform(0.36, 0.44)
    thick = 0.05
    supports = [
        _slab((x, (height - thick) / 2, 0), (0.07, height - thick, depth - 0.08), "wood")
        for x in (-width / 2 + 0.2, width / 2 - 0.2)
    ]
    return move_blocks(
        [*supports, _slab((0, height - thick / 2, 0), (width, thick, depth), "wood")],
        place,
        yaw,
        surface="seat",
    )


def bed(rng: np.random.Generator, place: Place, yaw: float) -> Blocks:
    """Build a bed with a headboard at -z and a pillow."""
    width = rng.uniform(1.0, 1.6)
    length = rng.uniform(2.0, 2.1)
    height = rng.uniform(0.40, 0.55)
    pillow = rng.uniform(0.07, 0.11)
    mattress = _slab((0, height - 0.10, 0), (width, 0.20, length), "fabric")
    frame = _slab(
        (0, (height - 0.20) / 2 + 0.04, 0), (width - 0.08, height - 0.28, length - 0.08), "wood"
    )
    head = _slab((0, 0.5, -length / 2 - 0.03), (width, 1.0, 0.05), "wood")
    cushion = _slab(
        (0, height + pillow / 2, -length / 2 + 0.22),
        (min(0.7, width - 0.2), pillow, 0.40),
        "fabric",
    )
    return move_blocks([mattress, frame, head, cushion], place, yaw, surface="bed")


def table(rng: np.random.Generator, place: Place, yaw: float) -> Blocks:
    """Build a table."""
    width = rng.uniform(1.0, 1.6)
    depth = rng.uniform(0.65, 0.85)
    height = rng.uniform(0.71, 0.77)
    top = _slab((0, height - 0.018, 0), (width, 0.036, depth), "wood")
    legs = _legs(width - 0.06, depth - 0.06, height - 0.036, 0.06)
    return move_blocks([top, *legs], place, yaw, surface="table")


def counter(rng: np.random.Generator, place: Place, yaw: float) -> Blocks:
    """Build a closed cupboard with a worktop."""
    width = rng.uniform(1.4, 2.2)
    depth = rng.uniform(0.45, 0.65)
    height = rng.uniform(0.88, 1.08)
    top = _slab((0, height - 0.02, 0), (width, 0.04, depth), "stone")
    return move_blocks(
        [
            top,
            _slab((0, (height - 0.04) / 2, 0), (width - 0.04, height - 0.04, depth - 0.06), "wood"),
        ],
        place,
        yaw,
        surface="cabinet",
    )


def shelf(rng: np.random.Generator, place: Place, yaw: float) -> Blocks:
    """Build a shelf with sides, back, boards and some closed boxes."""
    width = rng.uniform(0.7, 1.1)
    height = rng.uniform(1.5, 2.0)
    depth = float(rng.uniform(0.28, 0.36))
    thick = 0.025
    blocks = [
        _slab((s * (width - thick) / 2, height / 2, 0), (thick, height, depth), "wood")
        for s in (1, -1)
    ]
    blocks.append(_slab((0, height / 2, -depth / 2 + 0.01), (width, height, 0.02), "wood"))
    count = int(height / 0.36)
    for k in range(count + 1):
        y = 0.06 + k * (height - 0.08) / count
        blocks.append(_slab((0, y, 0), (width, thick, depth), "wood"))
        if k < count and rng.random() < 0.6:
            wide = float(rng.uniform(0.2, 0.45))
            tall = float(rng.uniform(0.14, 0.24))
            free = (width - wide) / 2 - thick
            x = float(rng.uniform(-free, free))
            blocks.append(
                _slab((x, y + (thick + tall) / 2, 0), (wide, tall, depth - 0.08), "fabric")
            )
    return move_blocks(blocks, place, yaw, surface="cabinet")


def railing(rng: np.random.Generator, place: Place, yaw: float) -> Blocks:
    """Build a handrail along x, with two lower rails and posts."""
    width = rng.uniform(1.2, 2.0)
    height = rng.uniform(0.92, 1.08)
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


def _slab(
    centre: tuple[float, float, float], size: tuple[float, float, float], material: str
) -> Block:
    """Return an axis-aligned box."""
    return Block(centre, (size[0] / 2, size[1] / 2, size[2] / 2), material=material)


def _tipped(
    foot: tuple[float, float, float],
    size: tuple[float, float, float],
    recline: float,
    material: str,
) -> Block:
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
        _slab(
            (x * (width - thick) / 2, height / 2, z * (depth - thick) / 2),
            (thick, height, thick),
            "wood",
        )
        for x in (-1, 1)
        for z in (-1, 1)
    ]
