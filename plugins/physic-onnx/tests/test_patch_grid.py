from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from physic_onnx.patch_grid import input_size_by_long_side, limit_patches

SIDES = st.integers(14, 4000)


@pytest.mark.parametrize(
    ("height", "width", "wanted"),
    [(1080, 1920, (280, 504)), (480, 640, (378, 504)), (504, 378, (504, 378)), (500, 1000, (252, 504))],
)
def test_the_long_side_becomes_504(height: int, width: int, wanted: tuple[int, int]) -> None:
    assert input_size_by_long_side(height, width, 504) == wanted


@given(SIDES, SIDES)
def test_sizes_are_whole_patches(height: int, width: int) -> None:
    rows, columns = input_size_by_long_side(height, width, 504)
    assert rows % 14 == columns % 14 == 0
    assert min(rows, columns) >= 14


@given(SIDES, SIDES, st.integers(16, 6000))
def test_a_limit_of_patches_reduces_and_never_enlarges(height: int, width: int, most: int) -> None:
    rows, columns = input_size_by_long_side(height, width, 504)
    less = limit_patches(rows, columns, most)
    assert less[0] % 14 == less[1] % 14 == 0
    assert less[0] <= rows
    assert less[1] <= columns
    # A strip of one patch cannot become thinner.
    assert (less[0] // 14) * (less[1] // 14) <= most or 14 in less
