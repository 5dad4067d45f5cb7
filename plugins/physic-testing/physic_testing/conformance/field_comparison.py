"""Comparison of two results or two sets of arguments, field by field."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

_TOLERANCE = 1e-3  # of the largest value: multi-threaded sums of a network are not bit-identical
_DIFFERENT_SHARE = 1e-3  # of the pixels of a mask or an image that may differ
_GREY_TOLERANCE = 2  # grey levels


def named_values(thing: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every array and value of a nested dataclass or tuple with its path, such as
    ("people.masks", array).
    """
    if is_dataclass(thing) and not isinstance(thing, type):
        for field in fields(thing):
            yield from named_values(
                getattr(thing, field.name), f"{path}.{field.name}" if path else field.name
            )
    elif isinstance(thing, tuple) and any(
        is_dataclass(t) or isinstance(t, tuple | np.ndarray) for t in thing
    ):
        for i, part in enumerate(thing):
            yield from named_values(part, f"{path}[{i}]")
    else:
        yield path, thing


def changed_fields(before: tuple[Any, ...], after: tuple[Any, ...]) -> list[str]:
    """Return the paths of the arguments whose values changed."""
    pairs = zip(named_values(before), named_values(after), strict=True)
    return [path or "image" for (path, old), (_, new) in pairs if not _identical(old, new)]


def describe_difference(first: Any, second: Any) -> str:
    """Describe the first difference of two results beyond rounding error; empty if they agree."""
    left = list(named_values(first))
    right = list(named_values(second))
    if [path for path, _ in left] != [path for path, _ in right]:
        return "the results have different fields"
    for (path, a), (_, b) in zip(left, right, strict=True):
        words = _difference(a, b)
        if words:
            return f"{path or 'image'}: {words}"
    return ""


def _identical(old: Any, new: Any) -> bool:
    """Return whether two values are equal, NaN equal to NaN."""
    if isinstance(old, np.ndarray):
        return (
            isinstance(new, np.ndarray)
            and old.shape == new.shape
            and np.array_equal(old, new, _has_nan(old))
        )
    return bool(old == new) or (old != old and new != new)


def _difference(a: Any, b: Any) -> str:
    """Describe the difference of two arrays or values; empty if they agree."""
    if not isinstance(a, np.ndarray) or not isinstance(b, np.ndarray):
        same = (
            _close(float(a), float(b))
            if isinstance(a, float) and isinstance(b, float)
            else bool(a == b)
        )
        return "" if same else f"{a!r} and {b!r}"
    if a.shape != b.shape:
        return f"shapes {a.shape} and {b.shape}"
    if not a.size:
        return ""
    if a.dtype.kind == "f":
        scale = float(np.abs(a[np.isfinite(a)]).max(initial=0))
        alike = np.isclose(a, b, rtol=_TOLERANCE, atol=_TOLERANCE * scale, equal_nan=True)
        other = int((~alike).sum())
        if other <= (_DIFFERENT_SHARE * a.size if a.ndim > 1 else 0):
            return ""
        gap = float(np.nanmax(np.abs(np.where(alike, 0, a.astype(np.float64) - b))))
        return (
            f"{other} of {a.size} numbers differ, by up to {gap:.3g} where the largest is "
            f"{scale:.3g}"
        )
    apart = np.abs(a.astype(np.int64) - b.astype(np.int64)) > (
        _GREY_TOLERANCE if a.dtype == np.uint8 else 0
    )
    return (
        f"{int(apart.sum())} of {a.size} values differ" if apart.mean() > _DIFFERENT_SHARE else ""
    )


def _close(a: float, b: float) -> bool:
    """Return whether two numbers agree up to rounding error."""
    return bool(np.isclose(a, b, rtol=_TOLERANCE, equal_nan=True))


def _has_nan(array: Any) -> bool:
    """Return whether an array's dtype can hold NaN."""
    return bool(array.dtype.kind == "f")
