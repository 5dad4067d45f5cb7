"""Errors of a configuration, formatted as ``path.in.the.file   what is wrong (got what)``."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

from physic_core.errors import BackendError, ConfigError

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError

__all__ = ["Fault", "Findings", "closest", "config_error", "from_pydantic"]

_COMPARISONS = {
    "less than inf": "a finite number",
    "greater than or equal to": ">=",
    "less than or equal to": "<=",
    "greater than": ">",
    "less than": "<",
}
_KINDS = {
    "a valid integer": "a whole number",
    "a valid number": "a number",
    "a valid boolean": "true or false",
    "a valid string": "a text",
    "a valid dictionary": "a table",
    "a valid tuple": "a list",
    "a valid list": "a list",
    "a finite number": "a finite number",
}


@dataclass(frozen=True)
class Fault:
    """One error.

    Attributes:
        path: dotted, as in the file: "metric_depth.options.scale".
        message: what is wrong, the value that was given, and what to do.
        of_plugin: whether the author of a plugin has to correct it, and not the user.
    """

    path: str
    message: str
    of_plugin: bool = False


@dataclass(frozen=True)
class Findings:
    """Result of one check.

    Attributes:
        faults: all errors.
        footer: last line of the message; may be empty.
        cause: exception that caused one of the errors, if any.
    """

    faults: tuple[Fault, ...] = ()
    footer: str = ""
    cause: BaseException | None = None


def config_error(
    faults: Iterable[Fault], source: Callable[[str], str], title: str, footer: str = ""
) -> ConfigError | BackendError:
    """Build one exception for all errors, grouped by file or flag.

    Args:
        faults: at least one.
        source: path -> the file or flag that set the value.
        title: heading for values that no file or flag set.
        footer: last line; may be empty.

    Returns:
        A BackendError if all errors are those of plugins, else a ConfigError.
    """
    groups: dict[str, list[Fault]] = {}
    for fault in dict.fromkeys(faults):
        label = source(fault.path)
        groups.setdefault(title if label == "default" else label, []).append(fault)
    blocks = []
    for label, group in groups.items():
        width = max(len(f.path) for f in group)
        lines = [f"{f.path:<{width}}   {f.message}" for f in group]
        blocks.append("\n".join([f"{label}: {len(group)} error{'s' * (len(group) > 1)}", *lines]))
    kind = BackendError if all(fault.of_plugin for group in groups.values() for fault in group) else ConfigError
    return kind("\n".join([*blocks, *([footer] if footer else [])]))


def from_pydantic(error: ValidationError, model: type[BaseModel], path: str = "", kind: str = "key") -> list[Fault]:
    """Convert errors of pydantic.

    Args:
        error: the exception of the validation.
        model: the validated model; its fields are suggested for unknown keys.
        path: dotted path of the validated table.
        kind: word for an unknown key, "key" or "option".
    """
    faults = []
    for found in error.errors(include_url=False):
        loc = [str(part) for part in found["loc"]]
        at = ".".join([*([path] if path else []), *loc])
        if found["type"] == "extra_forbidden":
            message = f"unknown {kind}{closest(loc[-1], _fields_at(model, loc[:-1]))}"
        else:
            message = _in_words(found)
        faults.append(Fault(at or path, message))
    return faults


def closest(name: str, known: Iterable[str]) -> str:
    """Return ". Did you mean 'x'?", or "" if no known name is similar."""
    close = get_close_matches(name, list(known), n=1)
    return f". Did you mean '{close[0]}'?" if close else ""


def _in_words(found: Any) -> str:
    if found["type"] == "missing":
        return "is missing"
    if found["type"] == "string_too_short" and found["input"] == "":
        return "should not be empty"
    if found["type"] == "value_error":
        return str(found["ctx"]["error"])
    if found["type"] == "model_type":
        return f"should be a table (got {found['input']!r})"
    text = re.sub(r"^Input should be", "should be", found["msg"])
    for words, sign in _COMPARISONS.items():
        text = text.replace(words, sign)
    for words, ours in _KINDS.items():
        if text.startswith(f"should be {words}"):
            text = f"should be {ours}"
    return f"{text[0].lower()}{text[1:]} (got {found['input']!r})"


def _fields_at(model: type[BaseModel], loc: list[str]) -> list[str]:
    """Field names of the nested model at ``loc``; empty if there is none."""
    fields = model.model_fields
    for part in loc:
        inner = fields[part].annotation if part in fields else None
        fields = getattr(inner, "model_fields", {})
    return list(fields)
