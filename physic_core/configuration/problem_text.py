"""Format problems of a configuration file as one exception message that lists all of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from physic_core.configuration.problems import Problem
from physic_core.configuration.quoting import printable, quoted, shorten
from physic_core.discovery.close_names import did_you_mean
from physic_core.errors import BackendError, ConfigError

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError

_COMPARISON_SIGNS = {
    "less than inf": "a finite number",
    "greater than or equal to": ">=",
    "less than or equal to": "<=",
    "greater than": ">",
    "less than": "<",
}
_TYPE_NAMES = {
    "a valid integer": "a whole number",
    "a valid number": "a number",
    "a valid boolean": "true or false",
    "a valid string": "a string",
    "a valid dictionary": "a table",
    "a valid tuple": "a list",
    "a valid list": "a list",
    "a finite number": "a finite number",
}
_MAX_BYTES = 4000
"""Maximum size of a message, bytes; further problems are only counted."""


def config_error(
    problems: Iterable[Problem], source: Callable[[str], str], title: str, footer: str = ""
) -> ConfigError | BackendError:
    """Build one exception that lists all problems, grouped by the file or flag that set the value.

    Args:
        problems: at least one.
        source: maps a dotted path to the file or flag that set its value.
        title: heading for values that no file or flag set.
        footer: last line; may be empty.

    Returns:
        A BackendError if plugins cause all problems, else a ConfigError.
    """
    groups: dict[str, list[Problem]] = {}
    for problem in dict.fromkeys(problems):
        label = source(problem.path)
        groups.setdefault(title if label == "default" else label, []).append(problem)
    lines: list[str] = []
    left_out, room = 0, _MAX_BYTES - len(_clean(footer, 500).encode())
    for label, group in groups.items():
        label = _clean(label, 200)
        shown = [(_clean(f.path, 100), _clean(f.message, 1000)) for f in group]
        width = max(len(path) for path, _ in shown)
        block = [f"{path:<{width}}   {message}" for path, message in shown]
        for i, line in enumerate(block):
            head = [f"{label}: {len(group)} error{'s' * (len(group) > 1)}"] if i == 0 else []
            size = len("\n".join([*head, line, ""]).encode())
            if left_out or size > room:
                left_out += 1
            else:
                room -= size
                lines += [*head, line]
    if left_out:
        lines.append(f"and {left_out:,} more error{'s' * (left_out > 1)}")
    kind = BackendError if all(problem.of_plugin for group in groups.values() for problem in group) else ConfigError
    return kind("\n".join([*lines, *([_clean(footer, 500)] if footer else [])]))


def problems_from_pydantic(
    error: ValidationError, model: type[BaseModel], path: str = "", kind: str = "key"
) -> list[Problem]:
    """Convert a validation error of pydantic to Problems.

    Args:
        error: the exception.
        model: the validated model; an unknown key is compared with its fields.
        path: dotted path of the validated table.
        kind: word for an unknown key, "key" or "option".
    """
    problems = []
    for found in error.errors(include_url=False):
        loc = [str(part) for part in found["loc"]]
        at = ".".join([*([path] if path else []), *loc])
        if callable(getattr(found["input"], "infer", None)):
            name = getattr(found["input"], "__name__", type(found["input"]).__name__)
            message = f"should be the name of a backend; give {name} as the argument backends={{'{loc[0]}': {name}}}"
        elif found["type"] == "extra_forbidden":
            message = f"unknown {kind}{did_you_mean(loc[-1], _fields_at(model, loc[:-1]))}"
        else:
            message = _describe_pydantic_error(found)
        problems.append(Problem(at or path, message))
    return problems


def _clean(text: str, limit: int) -> str:
    return printable(shorten(text, limit))


def _describe_pydantic_error(found: Any) -> str:
    if found["type"] == "missing":
        return "is missing"
    if found["type"] == "string_too_short" and found["input"] == "":
        return "should not be empty"
    if found["type"] == "value_error":
        return str(found["ctx"]["error"])
    if found["type"] == "model_type":
        return f"should be a table (got {quoted(found['input'])})"
    text = re.sub(r"^Input should be", "should be", found["msg"])
    for words, sign in _COMPARISON_SIGNS.items():
        text = text.replace(words, sign)
    for words, name in _TYPE_NAMES.items():
        if text.startswith(f"should be {words}"):
            text = f"should be {name}"
    return f"{text[0].lower()}{text[1:]} (got {quoted(found['input'])})"


def _fields_at(model: type[BaseModel], loc: list[str]) -> list[str]:
    """Return the field names of the nested model at ``loc``, or an empty list if there is none."""
    fields = model.model_fields
    for part in loc:
        inner = fields[part].annotation if part in fields else None
        fields = getattr(inner, "model_fields", {})
    return list(fields)
