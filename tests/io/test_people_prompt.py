"""The user's choice of people: mask files, validation, and px of the photo file turned into px of the image."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from physic_core.errors import InputError
from physic_core.io.people_prompt import check_prompt, read_masks, resize_prompt
from physic_core.types import PeoplePrompt


def values(*rows: list[int]) -> np.ndarray:
    return np.array(rows, np.uint8)


def test_the_values_of_an_indexed_png_are_people_in_ascending_order(tmp_path: Path) -> None:
    image = Image.fromarray(values([0, 2, 2], [1, 0, 0]), "L").convert("P")
    image.putdata([0, 2, 2, 1, 0, 0])
    image.save(tmp_path / "people.png")
    masks, note = read_masks(tmp_path / "people.png")
    assert note == ""
    assert masks.tolist() == [[[0, 0, 0], [1, 0, 0]], [[0, 1, 1], [0, 0, 0]]]


def test_a_mask_in_black_and_white_is_one_person(tmp_path: Path) -> None:
    Image.fromarray(values([0, 255], [255, 0])).save(tmp_path / "person.png")
    assert read_masks(tmp_path / "person.png")[0].tolist() == [[[False, True], [True, False]]]


def test_the_values_of_a_grey_file_are_people_where_each_fills_an_area(tmp_path: Path) -> None:
    pixels = np.zeros((20, 30), np.uint8)
    pixels[4:14, 3:12], pixels[4:9, 15:18] = 1, 200
    Image.fromarray(pixels).save(tmp_path / "m.png")
    masks, note = read_masks(tmp_path / "m.png")
    assert (masks.sum((1, 2)).tolist(), note) == ([90, 15], "")


@pytest.mark.parametrize("size", [(100, 80), (150, 120), (500, 400)])
def test_a_resized_mask_with_grey_edges_is_one_person(tmp_path: Path, size: tuple[int, int]) -> None:
    y, x = np.mgrid[:160, :200]
    person = ((x - 100) / 60) ** 2 + ((y - 80) / 70) ** 2 < 1
    Image.fromarray(np.uint8(255 * person)).resize(size, Image.Resampling.BILINEAR).save(tmp_path / "m.png")
    masks, note = read_masks(tmp_path / "m.png")
    assert len(masks) == 1
    assert masks.mean() == pytest.approx(person.mean(), rel=0.02)
    assert "smoothed edges" in note


@pytest.mark.parametrize(
    ("pixels", "message"),
    [
        (np.zeros((4, 4), np.uint8), "every pixel is 0, the background"),
        (np.zeros((4, 4, 3), np.uint8), "the pixels are RGB, not single numbers"),
    ],
)
def test_a_file_that_holds_no_masks_is_refused(tmp_path: Path, pixels: np.ndarray, message: str) -> None:
    Image.fromarray(pixels).save(tmp_path / "m.png")
    with pytest.raises(InputError, match=message):
        read_masks(tmp_path / "m.png")


@pytest.mark.parametrize(
    ("prompt", "words"),
    [
        (PeoplePrompt(), "no person is chosen"),
        (PeoplePrompt(points=((3, 3), (40, 3))), r"point 2 \(40, 3\) lies outside"),
        (PeoplePrompt(points=((1, float("nan")),)), r"finite numbers \(got \(1, nan\)\)"),
        (PeoplePrompt(boxes=((9, 2, 3, 8),)), r"box 1 \(9, 2, 3, 8\) is empty"),
        (PeoplePrompt(boxes=((40, 2, 50, 8),)), r"box 1 \(40, 2, 50, 8\) lies outside"),
        (PeoplePrompt(masks=np.ones((1, 40, 30), bool)), "masks have 30 x 40 px"),
        (PeoplePrompt(masks=np.ones((2, 30, 40), bool)), "overlap"),
        (PeoplePrompt(masks=np.zeros((1, 30, 40), bool)), "mask 1 has no pixels"),
        (PeoplePrompt(masks=np.ones((30, 40), np.uint8)), r"\(30, 40\) uint8"),
    ],
)
def test_a_choice_that_cannot_be_meant_is_refused(prompt: PeoplePrompt, words: str) -> None:
    with pytest.raises(InputError, match=words):
        check_prompt(prompt, 40, 30)


def test_prompts_follow_the_size_of_the_image() -> None:
    mask = np.zeros((1, 30, 40), bool)
    mask[0, 10:20, 20:30] = True
    smaller = resize_prompt(PeoplePrompt(((0, 0), (39, 29)), ((20, 10, 30, 20),), mask), (40, 30), (20, 15))
    # The centre of the first pixel lies a quarter of a larger pixel before that of the first large one.
    assert smaller.points == ((-0.25, -0.25), (19.25, 14.25))
    assert smaller.boxes == ((10.0, 5.0, 15.0, 10.0),)
    assert smaller.masks is not None
    rows, columns = np.nonzero(smaller.masks[0])
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (5, 9, 10, 14)


def test_a_mask_that_vanishes_when_the_photo_is_reduced_is_reported() -> None:
    mask = np.zeros((1, 30, 40), bool)
    mask[0, 29, 39] = True
    with pytest.raises(InputError, match="mask 1 has no pixels at 8 x 6 px"):
        resize_prompt(PeoplePrompt(masks=mask), (40, 30), (8, 6))
