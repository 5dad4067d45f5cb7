"""Furniture: stands on the ground, and turns as a whole."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from physic_testing.worlds import furniture
from physic_testing.worlds.solids import BLOCK_MATERIALS, LEVEL_GROUND, Block, signed_distance

_PIECES = ("bed", "bench", "chair", "counter", "railing", "shelf", "sofa", "stool", "table")


def _build(name: str, seed: int) -> tuple[Block, ...]:
    build: Callable[..., tuple[Block, ...]] = getattr(furniture, name)
    return build(np.random.default_rng(seed), (0.0, 0.0), 0.0)


@pytest.mark.parametrize("name", _PIECES)
@pytest.mark.parametrize("seed", range(3))
def test_a_piece_stands_on_the_ground_in_one_place(name: str, seed: int) -> None:
    blocks = _build(name, seed)
    corners = np.concatenate([block.corners() for block in blocks])
    assert -0.03 < corners[:, 1].min() <= 0.07
    assert 0.3 < corners[:, 1].max() < 2.7
    assert np.abs(corners[:, [0, 2]]).max() < 1.6
    assert {block.material for block in blocks} <= set(BLOCK_MATERIALS)
    assert blocks == _build(name, seed)
    assert blocks != _build(name, seed + 10)


def test_moving_a_piece_moves_its_distance() -> None:
    blocks = _build("sofa", 1)
    carried = furniture.move_blocks(blocks, (1.0, -2.0), np.pi / 2)
    points = np.random.default_rng(0).uniform((-1, 2, -1), (1, 3, 1), (50, 3))
    turned = np.stack([points[:, 2] + 1.0, points[:, 1], -points[:, 0] - 2.0], axis=1)
    assert signed_distance(turned, carried, LEVEL_GROUND) == pytest.approx(
        signed_distance(points, blocks, LEVEL_GROUND), abs=1e-9
    )
