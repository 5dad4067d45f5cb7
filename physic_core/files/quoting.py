"""Text of others in messages: short, and without characters that a terminal obeys."""

from __future__ import annotations

from typing import Any


def quoted(value: Any) -> str:
    """Return the ``repr`` of a value, shortened to 200 characters."""
    return shorten(repr(value), 200)


def shorten(text: str, limit: int) -> str:
    """Return a text with its middle omitted if it has more than ``limit`` characters."""
    if len(text) <= limit:
        return text
    end = limit // 3
    return f"{text[: limit - end - 5]} ... {text[-end:]}"


def printable(text: str) -> str:
    """Escape characters that a terminal obeys or cannot print; newlines and tabs are kept."""
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode("ascii") for c in text)
