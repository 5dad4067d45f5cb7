"""One-line text of a plugin's exception, with file and line in the plugin."""

from __future__ import annotations

import os
import traceback
from collections.abc import Iterator
from pathlib import PurePath

__all__ = ["debugging", "describe", "traceback_text"]

_OURS = ("physic_core", "importlib", "pluggy")
"""Modules that call or import plugins: their frames are skipped, since they do not locate a plugin's error."""


def describe(error: BaseException, *owners: str | type) -> str:
    """Class, message and place of an exception, as "ValueError: no floor (my_pkg/depth.py:29)".

    The place is the innermost frame in the owners' own code, else the innermost of all.

    Args:
        error: the exception.
        owners: the plugin's modules, by name, or its classes.
    """
    message = str(error)
    text = f"{type(error).__name__}: {message}" if message else type(error).__name__
    place = (
        "" if isinstance(error, SyntaxError) else _place(error, owners)
    )  # the text of a SyntaxError contains its place
    return f"{text} ({place})" if place else text


def debugging() -> bool:
    """Whether ``PHYSIC_DEBUG`` is set to show tracebacks."""
    return os.environ.get("PHYSIC_DEBUG", "0") not in ("", "0")


def traceback_text(error: BaseException | None) -> str:
    """The traceback of an exception and of its causes if ``PHYSIC_DEBUG`` is set, else an empty text."""
    return "".join(traceback.format_exception(error)) if error is not None and debugging() else ""


def _place(error: BaseException, owners: tuple[str | type, ...]) -> str:
    names = {owner if isinstance(owner, str) else owner.__module__ for owner in owners}
    packages = {_package(name) for name in names} - {"", "physic_core"}
    last = ""
    found = ""
    for module, place in _frames(error):
        if _package(module) in packages:
            found = place
        last = "" if _package(module) in _OURS else place
    return found or last


def _frames(error: BaseException) -> Iterator[tuple[str, str]]:
    """Module and "folder/file.py:line" of each frame, the innermost last."""
    for frame, line in traceback.walk_tb(error.__traceback__):
        module = str(frame.f_globals.get("__name__", ""))
        file = PurePath(frame.f_code.co_filename).name
        folders = module.split(".") if file == "__init__.py" else module.split(".")[:-1]
        yield module, f"{'/'.join([*folders, file])}:{line}"


def _package(module: str) -> str:
    return module.partition(".")[0]
