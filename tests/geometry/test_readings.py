"""Masks and depth maps that show the photo otherwise are named."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.geometry.readings import turned_masks

MASKS = np.zeros((2, 120, 160), bool)
MASKS[0, 20:110, 10:40] = True
MASKS[1, 40:110, 70:95] = True


@pytest.mark.parametrize(
    ("given", "what"),
    [
        (MASKS, ""),
        (MASKS[:1], ""),
        (MASKS[..., ::-1], "mirrored"),
        (MASKS[:, ::-1], "upside down"),
        (MASKS[:, ::-1, ::-1], "turned by 180 degrees"),
        (MASKS.any(0)[None], ""),
        (~MASKS, "inverted"),
        (~MASKS.any(0)[None], "inverted"),
    ],
)
def test_masks_of_a_turned_picture_are_named(given, what):
    assert turned_masks(given, MASKS).partition(":")[0] == what
