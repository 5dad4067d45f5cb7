from __future__ import annotations

from dataclasses import fields, is_dataclass

import numpy as np
import pytest


@pytest.fixture(scope="session")
def assert_same():
    """``assert_same(left, right)``: results are equal to the last bit."""

    def check(left, right, where="reconstruction"):
        assert type(left) is type(right), where
        if is_dataclass(left):
            for field in fields(left):
                check(
                    getattr(left, field.name), getattr(right, field.name), f"{where}.{field.name}"
                )
        elif isinstance(left, np.ndarray):
            assert left.dtype == right.dtype, where
            np.testing.assert_array_equal(left, right, err_msg=where)
        elif isinstance(left, tuple | list):
            assert len(left) == len(right), where
            for index, (one, other) in enumerate(zip(left, right, strict=True)):
                check(one, other, f"{where}[{index}]")
        elif isinstance(left, dict):
            assert list(left) == list(right), where
            for key in left:
                check(left[key], right[key], f"{where}[{key!r}]")
        else:
            assert left == right or (left != left and right != right), where

    return check
