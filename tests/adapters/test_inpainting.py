"""Filling what a mask covers, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.adapters.inpainting import inpaint_masked
from physic_core.errors import BackendError

IMAGE = np.arange(60 * 80 * 3, dtype=np.uint32).reshape(60, 80, 3).astype(np.uint8)


def middle() -> np.ndarray:
    mask = np.zeros((60, 80), bool)
    mask[20:30, 30:50] = True
    return mask


def test_only_the_mask_is_filled_though_more_is_shown_as_a_hole():
    shown = []
    filled = inpaint_masked(IMAGE, middle(), 0.05, lambda image, hole: shown.append(hole) or np.zeros_like(image))
    assert (filled[middle()] == 0).all()
    assert (filled[~middle()] == IMAGE[~middle()]).all()
    rows, columns = np.nonzero(shown[0])
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (16, 33, 26, 53)


def test_without_a_hole_the_network_is_not_called_and_a_copy_is_returned():
    filled = inpaint_masked(IMAGE, np.zeros((60, 80), bool), 0.1, lambda image, hole: pytest.fail("asked"))
    assert (filled == IMAGE).all()
    assert not np.shares_memory(filled, IMAGE)


@pytest.mark.parametrize(
    ("mask", "words"),
    [
        (
            np.zeros((80, 60), bool),
            r"must have the image's size \(H, W\) = \(60, 80\), got \(80, 60\): resize it first",
        ),
        (np.ones((60, 80), bool), "covers the whole image, which leaves nothing to fill it from: pass a smaller one"),
    ],
)
def test_a_mask_that_cannot_be_filled_is_refused(mask, words):
    with pytest.raises(BackendError, match=words):
        inpaint_masked(IMAGE, mask, 0.0, lambda image, hole: image)
