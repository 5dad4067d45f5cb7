"""A value of another program's file is of its kind, or refused with its name."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.files import boolean, count, entries, identity, matrix, number


@pytest.mark.parametrize("value", [7, 7.0, np.float32(7), np.int64(7)])
def test_a_number_is_read_as_it_is(value):
    assert number(value, "x") == count(value, "x") == 7


@pytest.mark.parametrize("value", ["7", True, None, [7], float("nan"), float("inf"), 10**400])
def test_what_is_no_number_is_refused_by_name(value):
    for read in (number, count):
        with pytest.raises(ValueError, match="focal"):
            read(value, "focal")


def test_a_part_is_no_whole_number():
    with pytest.raises(ValueError, match="person should be a whole number"):
        count(1.5, "person")


def test_only_true_false_0_1_and_nothing_are_booleans():
    given = [boolean(value, "ignore") for value in (True, False, 1, 0, None)]
    assert given == [True, False, True, False, False]
    for value in ("false", "true", 2, [], 0.5):
        with pytest.raises(ValueError, match="ignore should be true or false"):
            boolean(value, "ignore")


def test_a_text_and_a_number_are_the_same_identity():
    assert identity("12", "id") == identity(12, "id") == identity(12.0, "id")
    for value in (True, None, 1.5):
        with pytest.raises(ValueError, match="id"):
            identity(value, "id")


def test_only_nothing_is_an_empty_list():
    assert entries(None, "images") == entries([], "images") == []
    for value in ("", 0, False, {}, "a"):
        with pytest.raises(ValueError, match="images should be a list"):
            entries(value, "images")


def test_a_matrix_holds_numbers_alone():
    assert matrix([[1, 2], [3, 4.5]], "K").tolist() == [[1, 2], [3, 4.5]]
    for values in ([["1", "2"]], [[1, 2], [3]], [None, 1.0], [10**400], [True, False]):
        with pytest.raises(ValueError, match="K should be numbers"):
            matrix(values, "K")
