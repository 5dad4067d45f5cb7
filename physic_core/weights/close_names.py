"""Suggest existing names for a misspelt name."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from itertools import takewhile

__all__ = ["format_choice", "similar_names"]

_MAX_SUGGESTIONS = 4
_MIN_PREFIX = 4
_MIN_PART = 3
_CERTAIN_RATIO = 0.8


def similar_names(name: str, names: Sequence[str]) -> list[str]:
    """Return names that contain a name, or up to four that are similar to it.

    A common prefix counts more than a common suffix: many names end with "-onnx" or "-hf", and users often write only
    a prefix such as "moge-2", or a part such as "sam".
    """
    if len(name) >= _MIN_PART and (containing := [other for other in names if name in other]):
        return sorted(containing)
    if alike := get_close_matches(name, names, n=1, cutoff=_CERTAIN_RATIO):
        return alike
    shared = max((_prefix_length(name, other) for other in names), default=0)
    if shared >= _MIN_PREFIX:
        return sorted(other for other in names if other.startswith(name[:shared]))[:_MAX_SUGGESTIONS]
    return get_close_matches(name, names, n=1)


def format_choice(names: Sequence[str]) -> str:
    """Format a list of names as a choice: "'a', 'b' or 'c'"."""
    quoted = [f"'{name}'" for name in names]
    return " or ".join([", ".join(quoted[:-1]), quoted[-1]] if len(quoted) > 1 else quoted)


def _prefix_length(one: str, other: str) -> int:
    """Return the length of the common prefix of two names."""
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(one, other, strict=False)))
