from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from physic_onnx.depth_maps import input_size_by_long_side, input_size_least_scaling, limit_patches

SIDES = st.integers(14, 4000)


@given(SIDES, SIDES)
def test_sizes_are_whole_patches(height: int, width: int) -> None:
    for rows, columns in (input_size_least_scaling(height, width, 518), input_size_by_long_side(height, width, 504)):
        assert rows % 14 == columns % 14 == 0
        assert min(rows, columns) >= 14


@given(SIDES, SIDES, st.integers(16, 6000))
def test_a_limit_of_patches_reduces_and_never_enlarges(height: int, width: int, most: int) -> None:
    rows, columns = input_size_least_scaling(height, width, 518)
    less = limit_patches(rows, columns, most)
    assert less[0] % 14 == less[1] % 14 == 0
    assert less[0] <= rows
    assert less[1] <= columns
    # A strip of one patch cannot become thinner.
    assert (less[0] // 14) * (less[1] // 14) <= most or 14 in less
