"""What is suggested for a name that there is not."""

from __future__ import annotations

import pytest

from physic_core.discovery.error_text import did_you_mean, similar_names

NAMES = (
    "big-lama",
    "lama-carve",
    "moge-2-vitl-normal",
    "moge-2-vits-normal",
    "sam2.1-hiera-tiny",
    "sam3-hf",
)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("moge-2", ["moge-2-vitl-normal", "moge-2-vits-normal"]),
        ("lama", ["big-lama", "lama-carve"]),
        ("big-lamma", ["big-lama"]),
        ("yolo", []),
    ],
)
def test_names_that_contain_it_come_before_similar_ones(name, expected):
    assert similar_names(name, NAMES) == expected


def test_the_hint_is_a_question():
    assert did_you_mean("lama", NAMES) == ". Did you mean 'big-lama' or 'lama-carve'?"
    assert did_you_mean("x" * 1000, NAMES) == ""
