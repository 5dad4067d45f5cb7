"""The values of a parsed file of another program: each is of its kind, or refused with its name.

Python turns texts and booleans into numbers, every text but the empty one into True, and overflows
at integers of hundreds of digits.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.files.text import quoted

if TYPE_CHECKING:
    from physic_core.types import Float64Array


def number(value: Any, what: str) -> float:
    """Return a finite number.

    Raises:
        ValueError: it is anything else, such as a text or a boolean.
    """
    if not _is_number(value):
        raise ValueError(f"{what} should be a number (got {quoted(value)})")
    try:
        found = float(value)
    except (OverflowError, TypeError):
        found = math.inf
    if not math.isfinite(found):
        raise ValueError(f"{what} should be a finite number (got {quoted(value)})")
    return found


def count(value: Any, what: str) -> int:
    """Return a whole number.

    Raises:
        ValueError: it is anything else.
    """
    if number(value, what) % 1:
        raise ValueError(f"{what} should be a whole number (got {quoted(value)})")
    return int(value)


def boolean(value: Any, what: str) -> bool:
    """Return whether a value is true; 0 and 1 count, and nothing is false.

    Raises:
        ValueError: it is anything else, such as "false".
    """
    if value not in (None, 0, 1):
        raise ValueError(f"{what} should be true or false (got {quoted(value)})")
    return bool(value)


def identity(value: Any, what: str) -> str:
    """Return a text or a whole number as a text, so that "1" and 1 are the same.

    Raises:
        ValueError: it is anything else.
    """
    return value if isinstance(value, str) else str(count(value, what))


def entries(value: Any, what: str) -> list[Any]:
    """Return a list, an empty one for nothing.

    Raises:
        ValueError: it is anything else, such as an empty text, which is false, too.
    """
    if not isinstance(value, list | None):
        raise ValueError(f"{what} should be a list (got {quoted(value)})")
    return value or []


def matrix(values: Any, what: str) -> Float64Array:
    """Return an array of numbers.

    Raises:
        ValueError: it is ragged, or holds anything but numbers.
    """
    found = values if isinstance(values, np.ndarray) else np.asarray(values, object)
    if found.dtype.kind == "O":
        wrong = [one for one in found.ravel() if not _is_number(one)]
        if wrong:
            raise ValueError(
                f"{what} should be numbers in rows of equal length (got {quoted(wrong[0])})"
            )
    elif found.dtype.kind not in "iuf":
        raise ValueError(f"{what} should be numbers (got {found.dtype})")
    try:
        return found.astype(np.float64)
    except OverflowError:
        raise ValueError(f"{what} should be numbers that are finite") from None


def _is_number(value: Any) -> bool:
    is_boolean = isinstance(value, bool | np.bool_)
    return isinstance(value, int | float | np.integer | np.floating) and not is_boolean
