"""Which names are meant by one that is none."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from itertools import takewhile

__all__ = ["in_words", "near"]

_MOST = 4
_TELLING = 4
_SURE = 0.8


def near(name: str, names: Sequence[str]) -> list[str]:
    """Up to four names that may be meant, the likeliest first.

    The beginning tells more than the end: many a name ends alike ("-onnx", "-hf"), and whoever knows the network alone
    writes "moge-2".
    """
    if alike := get_close_matches(name, names, n=1, cutoff=_SURE):
        return alike
    shared = max((_shared(name, other) for other in names), default=0)
    if shared >= _TELLING:
        return sorted(other for other in names if other.startswith(name[:shared]))[:_MOST]
    return get_close_matches(name, names, n=1)


def in_words(names: Sequence[str]) -> str:
    """Names as a choice: "'a', 'b' or 'c'"."""
    quoted = [f"'{name}'" for name in names]
    return " or ".join([", ".join(quoted[:-1]), quoted[-1]] if len(quoted) > 1 else quoted)


def _shared(one: str, other: str) -> int:
    """How many letters two names begin with alike."""
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(one, other, strict=False)))
