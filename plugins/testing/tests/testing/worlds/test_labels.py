from __future__ import annotations

import io
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from physic_core.errors import InputError
from physic_testing import load_world, world_of
from physic_testing.worlds.labels import SMALLEST_PX, embed_label, read_label

pytestmark = pytest.mark.quick

names = st.text(st.characters(min_codepoint=1, exclude_categories=["Cs"]), min_size=1, max_size=8)
sizes = st.tuples(st.integers(SMALLEST_PX, 90), st.integers(SMALLEST_PX, 90))


def picture(size, seed=0):
    return np.random.default_rng(seed).integers(0, 256, (*size, 3), dtype=np.uint8)


@given(names, sizes)
def test_a_label_is_read_back_from_the_image(name, size):
    image = picture(size)
    stamped = embed_label(image, name)
    assert read_label(stamped) == name
    assert np.abs(stamped.astype(int) - image).max() <= 1


def test_a_label_outlives_png_and_holes_over_three_corners():
    stamped = embed_label(picture((64, 80)), "sit_on_sofa")
    file = io.BytesIO()
    Image.fromarray(stamped).save(file, "PNG")
    stamped = np.array(Image.open(file))
    ends = (slice(20), slice(-20, None))
    for corner in product(ends, ends):
        holed = np.full_like(stamped, 255)
        holed[corner] = stamped[corner]
        assert read_label(holed) == "sit_on_sofa"


def test_a_label_does_not_outlive_jpeg():
    file = io.BytesIO()
    Image.fromarray(embed_label(picture((64, 64)), "stand")).save(file, "JPEG", quality=95)
    assert read_label(np.array(Image.open(file))) == ""


@pytest.mark.parametrize(
    "image", [np.zeros((64, 64), np.uint8), np.zeros((21, 64, 3), np.uint8), np.zeros((64, 64, 3))]
)
def test_an_image_that_cannot_hold_a_label_has_none(image):
    assert read_label(image) == ""


def test_the_world_of_a_photo_is_found_by_its_label():
    world = load_world("stand", (320, 240))
    assert world_of(world.image) is world_of(world.empty_image) is world
    assert world_of(picture((64, 64))) is None
    assert world_of(embed_label(picture((64, 64)), "no world")) is None


def test_what_does_not_fit_is_refused():
    image = picture((64, 64))
    with pytest.raises(InputError, match="1 to 32 bytes"):
        embed_label(image, "x" * 33)
    with pytest.raises(InputError, match="22 x 22 px"):
        embed_label(image[:20], "stand")
