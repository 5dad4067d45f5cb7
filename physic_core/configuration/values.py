"""Parse the TOML of a configuration, and check that its values have TOML types."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any

from physic_core.configuration.problems import Problem
from physic_core.configuration.quoting import shorten

_MAX_DEPTH = 16
"""Maximum nesting of tables and lists. The deepest setting has four, backend options seldom more."""

_MAX_VALUES = 100_000
"""Maximum values of one layer. A file with every setting has 300; others are list entries."""

_MAX_TEXT = 10_000
"""Maximum characters of one string. A path has at most 4,096."""

_MAX_PROBLEMS = 20


class InvalidTextError(Exception):
    """Raised if a text is not valid TOML; the message is the reason."""


def parse_toml(text: str) -> dict[str, Any]:
    """Parse a TOML document.

    Raises:
        InvalidTextError: it is not valid, an integer has thousands of digits, or it is nested too deeply to be read.
    """
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # TOMLDecodeError is a ValueError
        raise InvalidTextError(_reason(error)) from error


def check_values(table: Mapping[Any, Any]) -> list[Problem]:
    """Return the problems of a layer that would make a later check fail or never end.

    These are keys that are not strings, integers of more than 64 bits (which TOML does not have), strings that no path
    or terminal can hold, and layers that are too deep or too large.
    """
    problems: list[Problem] = []
    rest: list[tuple[str, Any, int]] = [("", table, 0)]
    for count in range(_MAX_VALUES + 1):
        if not rest or len(problems) == _MAX_PROBLEMS:
            return problems
        path, value, depth = rest.pop()
        is_container = isinstance(value, Mapping | list | tuple)
        if is_container and depth > _MAX_DEPTH:
            problems.append(Problem(path, f"is nested more than {_MAX_DEPTH} deep"))
        elif is_container and count + len(rest) + len(value) > _MAX_VALUES:
            problems.append(Problem(path, f"has more than {_MAX_VALUES:,} values"))
        elif isinstance(value, Mapping):
            for key, item in list(value.items())[::-1]:
                at = f"{path}.{key}" if path else str(key)
                if not isinstance(key, str) or _text_problem(key):
                    problems.append(Problem(shorten(ascii(key), 100), "is not a valid setting name"))
                else:
                    rest.append((at, item, depth + 1))
        elif isinstance(value, list | tuple):
            rest.extend((path, item, depth + 1) for item in reversed(value))
        elif isinstance(value, int) and not -(1 << 63) <= value < 1 << 63:
            problems.append(Problem(path, f"should have at most 64 bits (got an integer of {value.bit_length():,})"))
        elif isinstance(value, str) and (message := _text_problem(value)):
            problems.append(Problem(path, message))
    return problems


def _text_problem(text: str) -> str:
    if len(text) > _MAX_TEXT:
        return f"should have at most {_MAX_TEXT:,} characters (got {len(text):,})"
    if "\0" in text:
        return f"should not contain null characters (got {shorten(ascii(text), 100)})"
    try:
        text.encode(errors="surrogateescape")  # Python writes bytes of a path that are not UTF-8 as surrogates
    except UnicodeEncodeError:
        return f"should not contain surrogates (got {shorten(ascii(text), 100)})"
    return ""


def _reason(error: Exception) -> str:
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    if "integer string conversion" in str(error):
        return "an integer has thousands of digits"
    return shorten(str(error), 500)
