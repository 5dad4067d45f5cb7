"""Keep the state of the process that changes numbers of others, while code of a plugin runs.

Such state belongs to all backends and to the engine: torch's default dtype, threads, environment
variables, random generators (:mod:`physic_core.discovery.process_settings` lists it). What a plugin
changes is restored and reported. A library that is first imported while the plugin runs is compared
with its state right after import.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from physic_core.discovery.process_settings import SETTINGS, Setting


@dataclass(frozen=True)
class Change:
    """A change of a setting.

    Attributes:
        name: of the setting.
        text: name and values.
        restored: whether the earlier value was set again.
    """

    name: str
    text: str
    restored: bool


def describe_changes(changes: list[Change]) -> str:
    """Return the end of a sentence about a plugin that made these changes; "" for none."""
    if not changes:
        return ""
    lost = ", ".join(change.name for change in changes if not change.restored)
    end = (
        f", but for {lost}: results of other backends and of the engine may differ" if lost else ""
    )
    return (
        f"changed {', '.join(change.text for change in changes)} of the whole process; it was "
        f"restored{end}"
    )


@contextmanager
def kept_process_state(*, loads: bool = False) -> Iterator[list[Change]]:
    """Restore the state of the process at the end of the block.

    Args:
        loads: whether the block loads a backend: networks are built with random weights before they
            read their own.

    Yields:
        A list that holds the changes after the block.
    """
    before = _read()
    changes = list[Change]()
    try:
        yield changes
    finally:
        changes += _restored(before, loads=loads)


def _read() -> dict[str, Any]:
    """Return the value of each setting whose library is imported, by the setting's name."""
    return {
        setting.name: value for setting in SETTINGS if (value := _value(setting)) is not _UNKNOWN
    }


def _restored(before: dict[str, Any], *, loads: bool) -> list[Change]:
    """Restore the values of :func:`_read`, one after another, and return what differed."""
    changes = []
    for setting in SETTINGS:
        earlier = _earlier(setting, before)
        later = _value(setting)
        if (
            earlier is _UNKNOWN
            or _library(setting) is None
            or (later is not _UNKNOWN and setting.same(earlier, later))
        ):
            continue
        restored = _restore(setting, earlier)
        if restored and setting.quiet_in_load and loads:
            continue
        more = "" if later is _UNKNOWN else setting.describe(earlier, later)
        changes.append(Change(setting.name, f"{setting.name}{more and f' ({more})'}", restored))
    return changes


class _Unknown:
    """Value of a setting that does not exist or cannot be read."""


_UNKNOWN = _Unknown()


def _library(setting: Setting) -> Any:
    """Return the imported module of a setting; None if it is not imported, or is being imported by
    another thread.
    """
    module = sys.modules.get(setting.library)
    return None if getattr(getattr(module, "__spec__", None), "_initializing", False) else module


def _value(setting: Setting) -> Any:
    module = _library(setting)
    if module is None:
        return _UNKNOWN
    try:
        return setting.read(module)
    except Exception:  # a library of another version, or one whose state contradicts itself
        return _UNKNOWN


def _earlier(setting: Setting, before: dict[str, Any]) -> Any:
    if setting.name in before:
        return before[setting.name]
    module = _library(setting)
    if module is None or setting.fresh is None:
        return _UNKNOWN
    try:
        return setting.fresh(module)
    except Exception:  # as in _value
        return _UNKNOWN


def _restore(setting: Setting, value: Any) -> bool:
    try:
        setting.write(_library(setting), value)
    # a handler outside the main thread, a folder that is gone
    except Exception:
        return False
    later = _value(setting)
    return later is not _UNKNOWN and setting.same(value, later)
