"""Convert values to and from strict JSON, with NaN and infinities as strings."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from typing import Any

_MAX_DEPTH = 200
_MAX_DIGITS = 60

_NON_FINITE = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}


def to_json(value: Any, *, digits: int | None = None) -> Any:
    """Convert a value to JSON types; NaN and infinities become "NaN", "Infinity" and "-Infinity".

    Args:
        value: NumPy arrays become lists, NumPy scalars numbers, paths strings, tuples and sets lists. The keys of a
            mapping become strings, and so does every object of another class.
        digits: significant digits to which floats are rounded; None keeps all.
    """
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        if not math.isfinite(value):
            return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
        return float(value) if digits is None else float(f"{value:.{digits}g}")
    if isinstance(value, Mapping):
        return {str(key): to_json(item, digits=digits) for key, item in value.items()}
    if isinstance(value, Sequence | set | frozenset):
        return [to_json(item, digits=digits) for item in value]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):  # NumPy's arrays and scalars, without importing NumPy
        return to_json(value.tolist(), digits=digits)
    return str(value)


def from_json(value: Any) -> Any:
    """Replace the strings "NaN", "Infinity" and "-Infinity" in a JSON value by numbers."""
    if isinstance(value, str):
        return _NON_FINITE.get(value, value)
    if isinstance(value, list):
        return [from_json(item) for item in value]
    if isinstance(value, dict):
        return {key: from_json(item) for key, item in value.items()}
    return value


def parse_json(content: bytes | str) -> Any:
    """Parse strict JSON in UTF-8; each key of an object occurs once, and each number is finite.

    Raises:
        ValueError: it is not JSON, an object has a key twice, a number is not finite or has more than 60 digits, or
            values are nested more than 200 deep.
    """
    text = content if isinstance(content, str) else content.decode("utf-8")
    try:
        value = json.loads(
            text, object_pairs_hook=_unique, parse_constant=_refuse, parse_float=_finite, parse_int=_integer
        )
    except RecursionError:
        raise ValueError(f"values are nested more than {_MAX_DEPTH} deep") from None
    level = [value]
    for _ in range(_MAX_DEPTH):
        level = [item for one in level if isinstance(one, dict | list) for item in _items(one)]
        if not level:
            return value
    raise ValueError(f"values are nested more than {_MAX_DEPTH} deep")


def _items(value: dict[str, Any] | list[Any]) -> list[Any]:
    return list(value.values()) if isinstance(value, dict) else value


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"an object has the key {twice[:60]!r} twice")
    return found


def _refuse(word: str) -> Any:
    raise ValueError(f"{word} is not a JSON number")


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"the number {text[:_MAX_DIGITS]} is too large")
    return number


def _integer(text: str) -> int:
    if len(text) > _MAX_DIGITS:
        raise ValueError(f"a number has {len(text)} digits")
    return int(text)
