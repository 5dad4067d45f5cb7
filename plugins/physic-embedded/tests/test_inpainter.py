from __future__ import annotations

import numpy as np
import pytest

from physic_core.errors import BackendError
from physic_core.interfaces import Inpainter
from physic_embedded.inpainter import MiGan, MiGanOptions
from physic_testing import violations


@pytest.fixture(scope="module")
def inpainter() -> MiGan:
    backend = MiGan(MiGanOptions(threads=1))
    backend.load()
    return backend


def scene(height: int, width: int) -> np.ndarray:
    """A bright wall over a darker floor."""
    image = np.full((height, width, 3), 190, np.uint8)
    image[height // 2 :] = (120, 90, 60)
    return image


@pytest.mark.parametrize(("height", "width"), [(301, 453), (600, 517), (64, 64), (40, 900)])
def test_only_the_hole_changes_at_any_size(inpainter: MiGan, height: int, width: int) -> None:
    image = np.random.default_rng(1).integers(0, 255, (height, width, 3), np.uint8)
    mask = np.zeros((height, width), bool)
    mask[height // 3 : height // 2, width // 4 : width // 2] = True
    before = image.copy()
    filled = inpainter.infer(image, mask)
    assert violations(Inpainter, filled, height=height, width=width) == []
    np.testing.assert_array_equal(filled[~mask], image[~mask])
    np.testing.assert_array_equal(image, before)
    assert (filled[mask] != image[mask]).any()


def test_a_thing_before_a_wall_is_gone(inpainter: MiGan) -> None:
    image = scene(400, 500)
    mask = np.zeros((400, 500), bool)
    mask[100:300, 220:280] = True
    red = image.copy()
    red[mask] = (255, 0, 0)
    filled = inpainter.infer(red, mask).astype(float)
    error = np.abs(filled - image)[mask].mean()
    print("mean error of the filled wall and floor", error, "of 255")
    assert error < 4


def test_a_mask_that_leaves_one_pixel_is_still_filled(inpainter: MiGan) -> None:
    image, mask = scene(300, 400), np.ones((300, 400), bool)
    mask[0, 0] = False
    filled = inpainter.infer(image, mask)
    np.testing.assert_array_equal(filled[0, 0], image[0, 0])


def test_an_empty_mask_returns_a_copy(inpainter: MiGan) -> None:
    image = scene(50, 60)
    filled = inpainter.infer(image, np.zeros((50, 60), bool))
    np.testing.assert_array_equal(filled, image)
    assert filled is not image


def test_a_mask_over_everything_is_refused(inpainter: MiGan) -> None:
    with pytest.raises(BackendError) as error:
        inpainter.infer(scene(20, 30), np.ones((20, 30), bool))
    assert str(error.value) == (
        "the mask covers the whole image, which leaves nothing to fill it from: pass a smaller one"
    )


def test_a_mask_of_another_size_is_refused(inpainter: MiGan) -> None:
    with pytest.raises(BackendError) as error:
        inpainter.infer(scene(20, 30), np.ones((30, 20), bool))
    assert str(error.value) == ("the mask must have the image's size (H, W) = (20, 30), got (30, 20): resize it first")
