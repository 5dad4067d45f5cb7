"""The user's choice of people: validation, and px of the photo file turned into px of the image."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.configuration.model import PhotoSettings
from physic_core.errors import ConfigError
from physic_core.io.photo import Photo
from physic_core.prepare.photo import prepare_photo
from physic_core.types import PeoplePrompt

FILE = (400, 300)


def prepared(prompt, size=FILE):
    """The prompt in a picture of a size that was read from a file of 400 x 300 px."""
    picture = np.random.default_rng(0).integers(0, 255, (*size[::-1], 3), np.uint8)
    return prepare_photo(Photo(picture, file_size=FILE), PhotoSettings(), prompt, None).people


@pytest.mark.parametrize(
    ("prompt", "words"),
    [
        (PeoplePrompt(), "no person is chosen"),
        (PeoplePrompt(points=((3, 3), (400, 3))), r"point 2 \(400, 3\) lies outside"),
        (PeoplePrompt(points=((1, float("nan")),)), r"finite numbers \(got \(1, nan\)\)"),
        (PeoplePrompt(boxes=((9, 2, 3, 8),)), r"box 1 \(9, 2, 3, 8\) is empty"),
        (PeoplePrompt(boxes=((0.1, 0.2, 0.5, 0.9),)), "fractions of the picture"),
        (PeoplePrompt(boxes=((400, 2, 500, 8),)), r"box 1 \(400, 2, 500, 8\) lies outside"),
        (PeoplePrompt(masks=np.ones((1, 400, 300), bool)), "masks have 300 x 400 px"),
        (PeoplePrompt(masks=np.ones((2, 300, 400), bool)), "overlap"),
        (PeoplePrompt(masks=np.zeros((1, 300, 400), bool)), "mask 1 has no pixels"),
        (PeoplePrompt(masks=np.ones((300, 400), np.uint8)), r"\(300, 400\) uint8"),
    ],
)
def test_a_choice_that_cannot_be_meant_is_refused(prompt, words):
    with pytest.raises(ConfigError, match=words):
        prepared(prompt)


def test_prompts_follow_the_size_of_the_image():
    mask = np.zeros((1, 300, 400), bool)
    mask[0, 100:200, 200:300] = True
    prompt = PeoplePrompt(((0, 0), (399, 299)), ((200, 100, 300, 200),), mask)
    smaller = prepared(prompt, (200, 150))
    # The centre of the first pixel lies a quarter of a larger pixel before that of the first large
    # one.
    assert smaller.points == ((-0.25, -0.25), (199.25, 149.25))
    assert smaller.boxes == ((100.0, 50.0, 150.0, 100.0),)
    expected = np.zeros((1, 150, 200), bool)
    expected[0, 50:100, 100:150] = True
    np.testing.assert_array_equal(smaller.masks, expected)
