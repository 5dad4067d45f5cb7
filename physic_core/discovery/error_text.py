"""Format an exception of a plugin as one line with its place in the plugin, and suggest names for a misspelt one."""

from __future__ import annotations

import os
import traceback
from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches
from itertools import takewhile
from pathlib import PurePath

from physic_core.discovery.plugin_code import plugin_error

_MAX_MESSAGE = 4096

_SKIPPED_PACKAGES = ("physic_core", "importlib", "pluggy")
"""Packages that call or import plugins; their frames do not locate a plugin's error."""

_MAX_LENGTH = 100  # comparing longer names takes long, and no known name is similar
_MAX_SUGGESTIONS = 4
_MIN_PREFIX = 4
_MIN_PART = 3
_CERTAIN_SIMILARITY = 0.8


def describe_error(error: BaseException, *owners: str | type) -> str:
    """Format class, message and code line of an exception, as "ValueError: no floor (my_pkg/depth.py:29)".

    The code line is that of the innermost frame in the plugin's code, else of the innermost frame.

    Args:
        error: the exception.
        owners: the plugin's modules, by name, or its classes.
    """
    error = plugin_error(error)
    message = message_of(error)
    text = f"{type(error).__name__}: {message}" if message else type(error).__name__
    # The message of a SyntaxError contains its place.
    place = "" if isinstance(error, SyntaxError) else _place(error, owners)
    return f"{text} ({place})" if place else text


def message_of(error: BaseException) -> str:
    """Return the message of an exception of a plugin, with at most 4,096 characters of it."""
    try:
        message = str(error)
    except Exception:  # of the plugin's class
        return "its message cannot be read"
    if len(message) <= _MAX_MESSAGE:
        return message
    return f"{message[:_MAX_MESSAGE]} ... ({len(message):,} characters)"


def is_debugging() -> bool:
    """Return whether the environment variable ``PHYSIC_DEBUG`` asks for tracebacks."""
    return os.environ.get("PHYSIC_DEBUG", "0") not in ("", "0")


def traceback_text(error: BaseException | None) -> str:
    """Return the traceback of an exception and of its causes if ``PHYSIC_DEBUG`` is set, else an empty text."""
    return "".join(traceback.format_exception(error)) if error is not None and is_debugging() else ""


def _place(error: BaseException, owners: tuple[str | type, ...]) -> str:
    names = {owner if isinstance(owner, str) else owner.__module__ for owner in owners}
    packages = {_package(name) for name in names} - {"", "physic_core"}
    last = ""
    found = ""
    for module, place in _frames(error):
        if _package(module) in packages:
            found = place
        last = "" if _package(module) in _SKIPPED_PACKAGES else place
    return found or last


def _frames(error: BaseException) -> Iterator[tuple[str, str]]:
    """Yield the module and "folder/file.py:line" of each frame, the innermost last."""
    for frame, line in traceback.walk_tb(error.__traceback__):
        module = str(frame.f_globals.get("__name__", ""))
        file = PurePath(frame.f_code.co_filename).name
        folders = module.split(".") if file == "__init__.py" else module.split(".")[:-1]
        yield module, f"{'/'.join([*folders, file])}:{line}"


def _package(module: str) -> str:
    return module.partition(".")[0]


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
