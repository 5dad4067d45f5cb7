"""The user's choice of people: validation, and px of the photo file turned into px of the image."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.errors import ConfigError
from physic_core.pipeline.given.photo import checked_prompt, resize_prompt
from physic_core.types import PeoplePrompt


@pytest.mark.parametrize(
    ("prompt", "words"),
    [
        (PeoplePrompt(), "no person is chosen"),
        (PeoplePrompt(points=((3, 3), (40, 3))), r"point 2 \(40, 3\) lies outside"),
        (PeoplePrompt(points=((1, float("nan")),)), r"finite numbers \(got \(1, nan\)\)"),
        (PeoplePrompt(boxes=((9, 2, 3, 8),)), r"box 1 \(9, 2, 3, 8\) is empty"),
        (PeoplePrompt(boxes=((0.1, 0.2, 0.5, 0.9),)), "shares of the picture"),
        (PeoplePrompt(boxes=((40, 2, 50, 8),)), r"box 1 \(40, 2, 50, 8\) lies outside"),
        (PeoplePrompt(masks=np.ones((1, 40, 30), bool)), "masks have 30 x 40 px"),
        (PeoplePrompt(masks=np.ones((2, 30, 40), bool)), "overlap"),
        (PeoplePrompt(masks=np.zeros((1, 30, 40), bool)), "mask 1 has no pixels"),
        (PeoplePrompt(masks=np.ones((30, 40), np.uint8)), r"\(30, 40\) uint8"),
    ],
)
def test_a_choice_that_cannot_be_meant_is_refused(prompt, words):
    with pytest.raises(ConfigError, match=words):
        checked_prompt(prompt, 40, 30)


def test_prompts_follow_the_size_of_the_image():
    mask = np.zeros((1, 30, 40), bool)
    mask[0, 10:20, 20:30] = True
    smaller = resize_prompt(
        PeoplePrompt(((0, 0), (39, 29)), ((20, 10, 30, 20),), mask), (40, 30), (20, 15)
    )
    # The centre of the first pixel lies a quarter of a larger pixel before that of the first large
    # one.
    assert smaller.points == ((-0.25, -0.25), (19.25, 14.25))
    assert smaller.boxes == ((10.0, 5.0, 15.0, 10.0),)
    assert smaller.masks is not None
    rows, columns = np.nonzero(smaller.masks[0])
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (5, 9, 10, 14)


def test_a_mask_that_vanishes_when_the_photo_is_reduced_is_reported():
    mask = np.zeros((1, 30, 40), bool)
    mask[0, 29, 39] = True
    with pytest.raises(ConfigError, match="mask 1 has no pixels at 8 x 6 px"):
        resize_prompt(PeoplePrompt(masks=mask), (40, 30), (8, 6))
