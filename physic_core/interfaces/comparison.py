"""Comparison of two results or two sets of arguments, field by field, and of values with what a
sigmoid gives.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import FloatArray

_TOLERANCE = 1e-3  # of the largest value: multi-threaded sums of a network are not bit-identical
_DIFFERENT_SHARE = 1e-3  # of the pixels of a mask or an image that may differ
_GREY_TOLERANCE = 2  # gray levels


def named_values(thing: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every array and value of a nested dataclass or tuple with its path, such as
    ("people.masks", array).
    """
    if is_dataclass(thing) and not isinstance(thing, type):
        for field in fields(thing):
            step = f"{path}.{field.name}" if path else field.name
            yield from named_values(getattr(thing, field.name), step)
    elif isinstance(thing, tuple) and any(
        is_dataclass(t) or isinstance(t, tuple | np.ndarray) for t in thing
    ):
        for i, part in enumerate(thing):
            yield from named_values(part, f"{path}[{i}]")
    else:
        yield path, thing


def describe_difference(first: Any, second: Any) -> str:
    """Describe the first difference of two results beyond rounding error; empty if they agree."""
    left = list(named_values(first))
    right = list(named_values(second))
    if [path for path, _ in left] != [path for path, _ in right]:
        return "the results have different fields"
    for (path, a), (_, b) in zip(left, right, strict=True):
        if words := _difference(a, b):
            return f"{path or 'image'}: {words}"
    return ""


def is_sigmoid_of_probability(values: FloatArray) -> bool:
    """Return whether all values lie where a sigmoid puts values from 0 to 1."""
    return bool(values.min() >= 0.5 and values.max() <= 1 / (1 + np.exp(-1.0)) + 1e-3)


def _difference(a: Any, b: Any) -> str:
    """Describe the difference of two arrays or values; empty if they agree."""
    if not isinstance(a, np.ndarray) or not isinstance(b, np.ndarray):
        are_floats = isinstance(a, float) and isinstance(b, float)
        near = are_floats and np.isclose(a, b, rtol=_TOLERANCE, equal_nan=True)
        return "" if near or (type(a) is type(b) and a == b) else f"{a!r} and {b!r}"
    if a.shape != b.shape:
        return f"shapes {a.shape} and {b.shape}"
    least = _DIFFERENT_SHARE * a.size
    if a.dtype.kind == "f":
        scale = float(np.abs(a[np.isfinite(a)]).max(initial=0))
        apart = ~np.isclose(a, b, rtol=_TOLERANCE, atol=_TOLERANCE * scale, equal_nan=True)
        least = 1 if a.ndim == 1 else least
    else:
        tolerance = _GREY_TOLERANCE if a.dtype == np.uint8 else 0
        apart = np.abs(a.astype(np.int64) - b.astype(np.int64)) > tolerance
    return f"{int(apart.sum())} of {a.size} numbers differ" if apart.sum() >= max(least, 1) else ""
