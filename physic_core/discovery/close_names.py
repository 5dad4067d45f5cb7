"""Suggest existing names for a misspelt name."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from itertools import takewhile

_MAX_LENGTH = 100  # comparing longer names takes long, and no known name is similar
_MAX_SUGGESTIONS = 4
_MIN_PREFIX = 4
_MIN_PART = 3
_CERTAIN_SIMILARITY = 0.8


def closest_name(name: str, known: Iterable[str], similarity: float = 0.6) -> str | None:
    """Return the known name that is closest to a misspelt one, or None if none has the similarity, from 0 to 1."""
    close = get_close_matches(name, list(known), n=1, cutoff=similarity) if len(name) <= _MAX_LENGTH else []
    return next(iter(close), None)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return the hint ". Did you mean 'x'?" for a misspelt name, or "" if no known name is similar."""
    close = closest_name(name, known)
    return f". Did you mean '{close}'?" if close else ""


def similar_names(name: str, names: Sequence[str]) -> list[str]:
    """Return names that contain a name, or up to four that are similar to it.

    A common prefix counts more than a common suffix: many names end with "-onnx" or "-hf", and users often write only
    a prefix such as "moge-2", or a part such as "sam".
    """
    if len(name) >= _MIN_PART and (containing := [other for other in names if name in other]):
        return sorted(containing)
    if alike := closest_name(name, names, _CERTAIN_SIMILARITY):
        return [alike]
    shared = max((_prefix_length(name, other) for other in names), default=0)
    if shared >= _MIN_PREFIX:
        return sorted(other for other in names if other.startswith(name[:shared]))[:_MAX_SUGGESTIONS]
    close = closest_name(name, names)
    return [close] if close else []


def format_choice(names: Sequence[str]) -> str:
    """Format a list of names as a choice: "'a', 'b' or 'c'"."""
    quoted = [f"'{name}'" for name in names]
    return " or ".join([", ".join(quoted[:-1]), quoted[-1]] if len(quoted) > 1 else quoted)


def _prefix_length(one: str, other: str) -> int:
    """Return the length of the common prefix of two names."""
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(one, other, strict=False)))
