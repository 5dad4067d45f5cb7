"""Pictures of networks: sizes, frames, colours and the pixels that are filled."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from physic_core.errors import BackendError
from physic_networks.pictures import (
    inpaint_masked,
    letterbox,
    resize_image,
    resize_map,
)

rng = np.random.default_rng(5)
PHOTO = rng.integers(0, 256, (37, 53, 3), np.uint8)


SIZES = pytest.mark.parametrize(("height", "width"), [(74, 106), (20, 90), (11, 13)])
KINDS = pytest.mark.parametrize("kind", ["bilinear", "bicubic"])


def torch_resized(image, height, width, mode):
    batch = torch.from_numpy(image).permute(2, 0, 1)[None]
    resized = torch.nn.functional.interpolate(
        batch, (height, width), mode=mode, align_corners=False
    )
    return resized[0].permute(1, 2, 0).numpy()


class TestSquash:
    @SIZES
    @KINDS
    def test_resizing_without_antialias_equals_torch(self, kind, height, width):
        image = PHOTO.astype(np.float32)
        np.testing.assert_allclose(
            resize_image(image, height, width, kind),
            torch_resized(image, height, width, kind),
            atol=1e-2,
        )

    @SIZES
    @KINDS
    def test_resizing_with_antialias_equals_pillow(self, kind, height, width):
        expected = Image.fromarray(PHOTO).resize(
            (width, height), getattr(Image.Resampling, kind.upper())
        )
        np.testing.assert_array_equal(
            resize_image(PHOTO, height, width, f"{kind}-antialias"), np.asarray(expected)
        )


def test_resample_keeps_places_by_half_pixel_centres():
    """A ramp of x coordinates, enlarged: each new pixel holds where its centre lies in the old
    image.
    """
    ramp = np.arange(10.0)[None].repeat(4, 0)
    larger = resize_map(ramp, 8, 30)
    expected = np.clip((np.arange(30) + 0.5) / 3 - 0.5, 0, 9)
    np.testing.assert_allclose(larger, expected[None].repeat(8, 0), atol=1e-5)


class TestLetterbox:
    @settings(max_examples=40, deadline=None)
    @given(
        rows=st.integers(5, 400),
        columns=st.integers(5, 400),
        height=st.integers(16, 300),
        width=st.integers(16, 300),
        where=st.sampled_from(["top-left", "centre"]),
    )
    def test_points_go_to_the_canvas_and_back(self, rows, columns, height, width, where):
        canvas, box = letterbox(np.zeros((rows, columns, 3), np.uint8), height, width, where=where)
        assert canvas.shape == (height, width, 3)
        assert box.crop(canvas).shape[:2] == box.inner
        corners = np.array(
            [[0.0, 0.0], [columns - 1, rows - 1], [-0.5, -0.5], [columns - 0.5, rows - 0.5]]
        )
        np.testing.assert_allclose(box.to_photo(box.to_canvas(corners)), corners, atol=1e-9)
        outer = box.to_canvas(corners[2:]) + 0.5
        np.testing.assert_allclose(
            outer,
            [[box.left, box.top], [box.left + box.inner[1], box.top + box.inner[0]]],
            atol=1e-9,
        )
        np.testing.assert_allclose(
            box.edges_to_photo(outer.ravel()), [0, 0, columns, rows], atol=1e-9
        )


IMAGE = np.arange(60 * 80 * 3, dtype=np.uint32).reshape(60, 80, 3).astype(np.uint8)


def middle():
    mask = np.zeros((60, 80), bool)
    mask[20:30, 30:50] = True
    return mask


def test_only_the_mask_is_filled_though_more_is_shown_as_a_hole():
    shown = []
    filled = inpaint_masked(
        IMAGE, middle(), 0.05, lambda image, hole: shown.append(hole) or np.zeros_like(image)
    )
    assert (filled[middle()] == 0).all()
    assert (filled[~middle()] == IMAGE[~middle()]).all()
    rows, columns = np.nonzero(shown[0])
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (16, 33, 26, 53)


@pytest.mark.parametrize(
    ("mask", "words"),
    [
        (
            np.zeros((80, 60), bool),
            r"must have the image's size \(H, W\) = \(60, 80\), got \(80, 60\): resize it first",
        ),
        (
            np.ones((60, 80), bool),
            "covers the whole image, which leaves nothing to fill it from: pass a smaller one",
        ),
    ],
)
def test_a_mask_that_cannot_be_filled_is_refused(mask, words):
    with pytest.raises(BackendError, match=words):
        inpaint_masked(IMAGE, mask, 0.0, lambda image, hole: image)
