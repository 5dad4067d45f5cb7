"""Format an exception of a plugin as one line with its place in the plugin, and suggest names for a
misspelt one.
"""

from __future__ import annotations

import os
import re
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from difflib import get_close_matches
from pathlib import PurePath
from typing import Any

from physic_core.errors import OutputError

_MAX_MESSAGE = 4096

_SKIPPED_PACKAGES = ("physic_core", "importlib", "pluggy")
"""Packages that call or import plugins; their frames do not locate a plugin's error."""

_MAX_LENGTH = 100  # comparing longer names takes long, and no known name is similar
_MIN_PART = 3


class PluginExit(Exception):
    """Raised in place of SystemExit or another BaseException of a plugin, which is its cause."""


def plugin_error(error: BaseException) -> BaseException:
    """Return the exception that a plugin raised: the cause of a PluginExit, or the error itself."""
    return (
        error.__cause__ if isinstance(error, PluginExit) and error.__cause__ is not None else error
    )


def describe_error(error: BaseException, *owners: str | type) -> str:
    """Format class, message and code line of an exception, as "ValueError: no floor
    (my_pkg/depth.py:29)".

    The code line is that of the innermost frame in the plugin's code, else of the innermost frame.

    Args:
        error: the exception.
        owners: the plugin's modules, by name, or its classes.
    """
    error = plugin_error(error)
    message = bounded_message(error)
    text = f"{type(error).__name__}: {message}" if message else type(error).__name__
    # The message of a SyntaxError contains its place.
    place = "" if isinstance(error, SyntaxError) else _frame_text(error, owners)
    return f"{text} ({place})" if place else text


def left_out_warning(what: str, error: BaseException) -> str:
    """Return the warning of a result that is complete without something whose making failed."""
    return f"{what} failed: {describe_error(error)}; the rest of the result is complete"


def make_optional_parts(parts: Mapping[str, Callable[[], Any]]) -> tuple[dict[str, Any], list[str]]:
    """Make parts of a result without which it is complete.

    Args:
        parts: what to call for each, by name.

    Returns:
        What was made by name, and a warning for each part that failed.

    Raises:
        OutputError: a file cannot be written.
    """
    made, warnings = {}, []
    for name, make in parts.items():
        try:
            made[name] = make()
        except OutputError:
            raise
        except Exception as error:
            warnings.append(left_out_warning(name, error))
    return made, warnings


def bounded_message(error: BaseException) -> str:
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
    """Return the traceback of an exception and of its causes if ``PHYSIC_DEBUG`` is set, else an
    empty text.
    """
    return (
        "".join(traceback.format_exception(error)) if error is not None and is_debugging() else ""
    )


def _frame_text(error: BaseException, owners: tuple[str | type, ...]) -> str:
    names = {owner if isinstance(owner, str) else owner.__module__ for owner in owners}
    packages = {_package(name) for name in names} - {"", "physic_core"}
    last = ""
    deepest = ""
    for module, place in _frames(error):
        if _package(module) in packages:
            deepest = place
        last = "" if _package(module) in _SKIPPED_PACKAGES else place
    return deepest or last


def _frames(error: BaseException) -> Iterator[tuple[str, str]]:
    """Yield the module and "folder/file.py:line" of each frame, the innermost last."""
    for frame, line in traceback.walk_tb(error.__traceback__):
        module = str(frame.f_globals.get("__name__", ""))
        file = PurePath(frame.f_code.co_filename).name
        folders = module.split(".") if file == "__init__.py" else module.split(".")[:-1]
        yield module, f"{'/'.join([*folders, file])}:{line}"


def _package(module: str) -> str:
    return module.partition(".")[0]


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ". Did you mean 'x' or 'y'?" with the known names that have this one at the start of a
    word, or with the most similar one; "" if none is.
    """
    names = sorted(known)
    part = re.compile(rf"(?:^|[^a-z0-9]){re.escape(name)}")
    close = [other for other in names if len(name) >= _MIN_PART and part.search(other)]
    if not close and len(name) <= _MAX_LENGTH:
        close = get_close_matches(name, names, n=1)
    named = " or ".join(f"'{other}'" for other in close)
    return f". Did you mean {named}?" if close else ""
