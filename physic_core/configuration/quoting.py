"""Quote user values in messages: short, and without control characters."""

from __future__ import annotations

import reprlib
from typing import Any


class _Repr(reprlib.Repr):
    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxstring, self.maxother = 4, 100, 100
        self.maxdict = self.maxlist = self.maxtuple = self.maxset = 8

    def repr_int(self, x: int, level: int) -> str:
        # Python refuses to print an integer of more than 4,300 digits.
        return repr(x) if x.bit_length() <= 128 else f"an integer of {x.bit_length():,} bits"


_REPR = _Repr()


def quoted(value: Any) -> str:
    """Return the ``repr`` of a value, shortened to 200 characters."""
    return shorten(_REPR.repr(value), 200)


def shorten(text: str, limit: int) -> str:
    """Return a text with its middle omitted if it has more than ``limit`` characters."""
    if len(text) <= limit:
        return text
    end = limit // 3
    return f"{text[: limit - end - 5]} ... {text[-end:]}"


def printable(text: str) -> str:
    """Escape characters that a terminal obeys or cannot print; newlines and tabs are kept."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode("ascii") for c in text)
