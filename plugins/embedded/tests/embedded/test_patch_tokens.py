"""Tokens of the depth network's encoder: where they are read, and that one pass serves two
backends.
"""

from __future__ import annotations

import numpy as np
import pytest

from physic_embedded.networks.patch_tokens import PatchTokens
from physic_networks.pictures import Letterbox


@pytest.fixture
def grid():
    """4 x 6 patches of 10 px, numbered by row and column; a photo of 120 x 60 px fills the middle
    two rows.
    """
    numbers = np.stack(np.meshgrid(np.arange(4.0), np.arange(6.0), indexing="ij"), axis=-1)
    return PatchTokens(numbers, 10, Letterbox(0.5, 0, 10, (20, 60), (40, 120)))


@pytest.mark.parametrize(
    ("box", "expected"),
    [
        ((20, 0, 60, 20), (1, 1.5)),
        ((0, 0, 120, 40), (1.5, 2.5)),
        ((41, 21, 42, 22), (2, 2)),
        ((-100, -100, 500, 500), (1.5, 2.5)),
    ],
)
def test_a_box_takes_every_patch_that_it_touches(grid, box, expected):
    [mean] = grid.mean_in_boxes(np.array([box], float))
    np.testing.assert_allclose(mean, expected)


def test_nobody_has_no_tokens(grid):
    assert (
        grid.mean_around(np.zeros((0, 2))).shape
        == grid.mean_in_boxes(np.zeros((0, 4))).shape
        == (0, 2)
    )
