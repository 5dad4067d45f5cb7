"""Untrusted text in messages and CSV files, and strict JSON with NaN and infinities as strings.

Control characters are escaped for terminals, and formulas for spreadsheets.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, TextIO

_QUOTED = ("'", "=", "+", "-", "@", "\t", "\r", "\n", "\uff1d", "\uff0b", "\uff0d", "\uff20")
"""First characters of a text that a spreadsheet computes, after the apostrophe that marks one; the
last four are full-width, for Japanese and Chinese.
"""

_MAX_DEPTH = 200
_TOO_DEEP = f"values are nested more than {_MAX_DEPTH} deep"
_NON_FINITE = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}


def quoted(value: Any) -> str:
    """Return the ``repr`` of a value, shortened to 200 characters."""
    return shorten(repr(value), 200)


def shorten(text: str, limit: int) -> str:
    """Return a text with its middle omitted if it has more than ``limit`` characters."""
    if len(text) <= limit:
        return text
    end = limit // 3
    return f"{text[: limit - end - 5]} ... {text[-end:]}"


def printable(text: str, kept: str = "\n\t") -> str:
    """Escape characters that a terminal obeys or cannot print, but for those that are kept."""
    return "".join(
        c if c.isprintable() or c in kept else c.encode("unicode_escape").decode("ascii")
        for c in text
    )


def path_problem(text: str) -> str:
    """Return why a text cannot be the path of a file or folder, as the end of a sentence; "" if it
    can.
    """
    if not text:
        return "it is empty: name a file or a folder"
    if re.match(r"(?:https?|ftp|file|data|s3|gs):", text, re.IGNORECASE):
        return (
            f"{quoted(text)} is an address, and PhySIC downloads nothing: save the file, and "
            f"name its path"
        )
    if text == "-":
        return "'-' is not a path: name a file, since streams are not read"
    if re.search(r"[*?]", text) and not os.path.lexists(text):
        return f"no file is named {quoted(text)}: without quotes, the shell puts names in its place"
    if "\0" in text:
        return f"{quoted(text)} has a null character, which no path has"
    return ""


def write_csv(file: TextIO, columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """Write a table: see :func:`csv_writer`."""
    write = csv_writer(file, columns)
    for row in rows:
        write(row)


def csv_writer(file: TextIO, columns: Sequence[str]) -> Callable[[Mapping[str, Any]], object]:
    """Write a line with the columns, and return a function that writes a row; a value that is
    missing or None is empty.

    A text that a spreadsheet would take for a formula has an apostrophe before it, and so has one
    that begins with an apostrophe: without the first apostrophe, each text is the original.

    Args:
        file: opened with ``newline=""``.
        columns: names; other entries of a row are skipped.
    """
    writer = csv.writer(file)
    writer.writerow(columns)
    return lambda row: writer.writerow(
        [_csv_cell(value) if isinstance(value, str) else value for value in map(row.get, columns)]
    )


def read_csv(text: str, needed: Sequence[str], others: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Yield the rows of a table whose first line names the columns.

    Args:
        text: CSV with commas.
        needed: columns that the table has.
        others: columns that it may have.

    Raises:
        ValueError: it is no such table, a column is unknown, missing or there twice, or a row has
            more cells than the first line.
    """
    reader = csv.DictReader(io.StringIO(text, newline=""), skipinitialspace=True)
    try:
        _check_columns(list(reader.fieldnames or ()), needed, others)
        for number, row in enumerate(reader, start=1):
            if None in row:
                raise ValueError(
                    f"row {number} has more cells than the first line: write numbers with a point "
                    '(1.7), and several in quotes ("1.7,1.8")'
                )
            yield row
    except csv.Error as error:
        raise ValueError(f"it is not CSV: {error}") from error


def _check_columns(columns: list[str], needed: Sequence[str], others: Sequence[str]) -> None:
    for mark, kind in (("\t", "tabs"), (";", "semicolons")):
        if any(mark in name for name in columns):
            raise ValueError(
                f"its cells are separated by {kind}: save it as CSV with commas between cells, and "
                "points in numbers"
            )
    allowed = (*needed, *others)
    if wrong := [name for name in columns if name not in allowed or columns.count(name) > 1]:
        why = "is there twice" if wrong[0] in allowed else f"is none of {', '.join(allowed)}"
        raise ValueError(f"its column {quoted(wrong[0])} {why}: remove or rename it")
    if missing := [name for name in needed if name not in columns]:
        raise ValueError(
            f"the first line lacks {', '.join(missing)} (got {quoted(','.join(columns))})"
        )


def _csv_cell(value: str) -> str:
    # Bytes of a file's name that are not UTF-8 are written as in the journal of a batch: \udcff.
    value = value.encode("utf-8", "backslashreplace").decode()
    return f"'{value}" if value.startswith(_QUOTED) else value


def to_json(value: Any, *, digits: int | None = None) -> Any:
    """Convert a value to JSON types; NaN and infinities become "NaN", "Infinity" and "-Infinity".

    Args:
        value: NumPy arrays become lists, NumPy scalars numbers, paths strings, tuples and sets
            lists. The keys of a mapping become strings, and so does every object of another class.
        digits: significant digits to which floats are rounded; None keeps all.
    """
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        if math.isnan(value):
            return "NaN"
        if math.isinf(value):
            return "Infinity" if value > 0 else "-Infinity"
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
    """Parse strict JSON in UTF-8, in which each number is finite.

    Raises:
        ValueError: it is not JSON, a number is not finite, an object has a key twice, or values are
            nested more than 200 deep.
    """
    try:
        value = json.loads(
            content,
            parse_constant=_refuse,
            parse_float=finite,
            parse_int=whole,
            object_pairs_hook=_unique_keys,
        )
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    return _not_too_deep(value)


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML.

    Raises:
        ValueError: it is not TOML, or values are nested more than 200 deep.
    """
    import tomllib

    try:
        value: dict[str, Any] = _not_too_deep(tomllib.loads(text))
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    return value


def _not_too_deep(value: Any) -> Any:
    level = [value]
    for _ in range(_MAX_DEPTH):
        level = [item for one in level for item in _child_values(one)]
        if not level:
            return value
    raise ValueError(_TOO_DEEP)


def _child_values(value: Any) -> Iterable[Any]:
    """Return what a JSON object or array holds; nothing for other values."""
    if isinstance(value, dict):
        return value.values()
    return value if isinstance(value, list) else ()


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) < len(pairs):
        raise ValueError("an object has a key twice")
    return values


def _refuse(word: str) -> Any:
    raise ValueError(f"{word} is not a JSON number")


def finite(text: str) -> float:
    """Return the number of a text, as ``parse_float`` of a decoder.

    Raises:
        ValueError: it is not finite.
    """
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"the number {text:.60} is too large")
    return number


def whole(text: str) -> int:
    """Return the whole number of a text, as ``parse_int`` of a decoder.

    Raises:
        ValueError: no float is as large.
    """
    finite(text)
    return int(text)
