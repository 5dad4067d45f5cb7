"""Up by the look of a picture: parts, the linear map, and the fitted numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from physic_embedded.networks.depth_anything import patch_tokens
from physic_embedded.networks.patch_tokens import PatchTokens
from physic_embedded.networks.sessions import open_packaged_session
from physic_embedded.single_view.gravity import (
    PICTURE_PATCHES,
    PICTURE_SIDE_PX,
    fitted_numbers,
    up_from_tokens,
)
from physic_networks.pictures import Letterbox

PHOTO = np.array(Image.open(Path(__file__).parents[4] / "examples" / "couple.jpg").convert("RGB"))


def tokens_of(grid):
    """Tokens of a picture of 10 px for each patch."""
    size = (10 * grid.shape[0], 10 * grid.shape[1])
    return PatchTokens(grid, 10, Letterbox(1.0, 0, 0, size, size))


def seen(picture):
    return patch_tokens(
        "depth_anything_v2_vits_int8",
        open_packaged_session,
        picture,
        PICTURE_SIDE_PX,
        PICTURE_PATCHES,
    )


def pitch_of(picture):
    return up_from_tokens(seen(picture), fitted_numbers()).pitch[0]


def test_up_is_turned_by_pitch_and_roll():
    numbers = {"angles": np.array([[0.0] * 9 + [30.0], [0.0] * 9 + [10.0]])}
    found = up_from_tokens(tokens_of(np.ones((6, 6, 1))), numbers)
    assert found.pitch[0] == pytest.approx(30)
    assert np.degrees(np.arctan2(found.up[0], -found.up[1])) == pytest.approx(10)
    assert np.linalg.norm(found.up) == pytest.approx(1)
    numbers = {"angles": np.zeros((2, 10))}
    assert up_from_tokens(tokens_of(np.ones((6, 6, 1))), numbers).sigma < 8 < 15 < found.sigma


def test_mirrored_tokens_have_the_mirrored_up():
    grid = np.random.default_rng(0).normal(size=(18, 24, 384))
    first, second = (
        up_from_tokens(tokens_of(one), fitted_numbers()).up for one in (grid, grid[:, ::-1])
    )
    np.testing.assert_allclose(first * [-1, 1, 1], second, atol=1e-4)


def test_the_lower_part_of_a_photo_looks_down_more_than_the_upper_part():
    height = len(PHOTO)
    assert pitch_of(PHOTO[height // 3 :]) > pitch_of(PHOTO[: -height // 3]) + 3
