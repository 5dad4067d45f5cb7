"""Text of others in messages, and in CSV files: no terminal obeys it, and no spreadsheet takes it for a formula."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TextIO

_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d", "\uff0b", "\uff0d", "\uff20")
"""With which a text begins that a spreadsheet computes; the last four have full width, for Japanese and Chinese."""


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


def write_csv(file: TextIO, columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """Write a line with the columns, then one for each row; a value that is missing or None is empty.

    A text that a spreadsheet would take for a formula has an apostrophe before it, and so has one that begins with an
    apostrophe: without the first apostrophe, each text is the original.

    Args:
        file: opened with ``newline=""``.
        columns: names.
        rows: column -> value; other entries are skipped.
    """
    writer = csv.DictWriter(file, columns, restval="", extrasaction="ignore")
    writer.writeheader()
    writer.writerows({name: _cell(value) for name, value in row.items()} for row in rows)


def as_utf8(value: Any) -> Any:
    """Write bytes of a file's name that are not UTF-8 as in the journal of a batch: ``\\udcff``."""
    return value.encode("utf-8", "backslashreplace").decode() if isinstance(value, str) else value


def _cell(value: Any) -> Any:
    value = as_utf8(value)
    return f"'{value}" if isinstance(value, str) and value.startswith((*_FORMULA, "'")) else value
