"""Suggest existing names for an unknown name."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from itertools import takewhile

__all__ = ["in_words", "near"]

_MOST = 4
_TELLING = 4
_SURE = 0.8


def near(name: str, names: Sequence[str]) -> list[str]:
    """Return up to four similar names, the most similar first.

    A common beginning counts more than a common end. Many names have the same end ("-onnx", "-hf"), and users often
    write only the beginning, such as "moge-2".
    """
    if alike := get_close_matches(name, names, n=1, cutoff=_SURE):
        return alike
    shared = max((_shared(name, other) for other in names), default=0)
    if shared >= _TELLING:
        return sorted(other for other in names if other.startswith(name[:shared]))[:_MOST]
    return get_close_matches(name, names, n=1)


def in_words(names: Sequence[str]) -> str:
    """Format names as a choice: "'a', 'b' or 'c'"."""
    quoted = [f"'{name}'" for name in names]
    return " or ".join([", ".join(quoted[:-1]), quoted[-1]] if len(quoted) > 1 else quoted)


def _shared(one: str, other: str) -> int:
    """Length of the common prefix of two names."""
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(one, other, strict=False)))
