"""Keep the settings of the process by which plugins change the numbers of others in practice:
working folder, environment, threads, and torch's default dtype.

What a plugin changes is restored and reported. A library that is first imported while the plugin
runs is compared with its state right after import. The conformance kit finds other settings.
"""

from __future__ import annotations

import os  # noqa: F401  # rows below name it
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

IMPORTED = frozenset(
    # torch, OpenCV, Ray
    {"CUDA_MODULE_LOADING", "LD_LIBRARY_PATH", "RAY_CLIENT_MODE", "TORCHINDUCTOR_CACHE_DIR"}
    | {"KMP_DUPLICATE_LIB_OK", "KMP_INIT_AT_FORK"}  # scikit-learn
    | {"ORT_DISABLE_TELEMETRY"}  # metricbody-embedded, before it imports onnxruntime
)
"""Environment variables that libraries set for themselves when they are imported or begin."""

LIMITING = "import torch"
"""Name of the thread that imports torch, and then limits its threads."""


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
def kept_process_state() -> Iterator[list[Change]]:
    """Restore the settings of the process at the end of the block.

    Yields:
        A list that holds the changes after the block.
    """
    before = {setting.name: _value(setting) for setting in _SETTINGS}
    changes = list[Change]()
    try:
        yield changes
    finally:
        changes += filter(None, (_restored(one, before[one.name]) for one in _SETTINGS))


@dataclass(frozen=True)
class _Setting:
    """A setting of the process.

    Attributes:
        name: in messages.
        library: module that must be imported for it to exist.
        read: returns its value, given the module.
        write: sets it, given the module and a value of ``read``.
        fresh: returns its value right after the module's import, given the module; None if it
            cannot be known.
        describe: text of a change, given both values.
    """

    name: str
    library: str
    read: Callable[[Any], Any]
    write: Callable[[Any, Any], object]
    fresh: Callable[[Any], Any] | None = None
    describe: Callable[[Any, Any], str] = "{} -> {}".format


def _library(setting: _Setting) -> Any:
    """Return the imported module of a setting; None if it is not imported, or is being imported by
    another thread.
    """
    module = sys.modules.get(setting.library)
    return None if getattr(getattr(module, "__spec__", None), "_initializing", False) else module


def _value(setting: _Setting, read: Callable[[Any], Any] | None = None) -> Any:
    """Return the value of a setting; None if it does not exist or cannot be read."""
    module = _library(setting)
    try:
        return None if module is None else (read or setting.read)(module)
    except Exception:  # a library of another version, a folder that is gone
        return None


def _restored(setting: _Setting, before: Any) -> Change | None:
    """Restore a value, and return the change; None if there was none."""
    if before is None and setting.fresh is not None:
        before = _value(setting, setting.fresh)
    later = _value(setting)
    if before is None or later == before:
        return None
    try:
        setting.write(_library(setting), before)
    except Exception:  # a folder that is gone
        restored = False
    else:
        restored = _value(setting) == before
    more = "" if later is None else f" ({setting.describe(before, later)})"
    return Change(setting.name, f"{setting.name}{more}", restored)


def _read_environment(module: Any) -> dict[str, str]:
    return {name: value for name, value in module.environ.items() if name not in IMPORTED}


def _restore_environment(module: Any, before: dict[str, str]) -> None:
    for name in _read_environment(module).keys() - before.keys():
        del module.environ[name]
    module.environ.update(before)


def _changed_names(before: dict[str, Any], after: dict[str, Any]) -> str:
    """Return the names whose values differ, without the values: those of variables may be
    secret.
    """
    return ", ".join(
        sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))
    )


def _default_opencv_threads(cv2: Any) -> int:
    current = cv2.getNumThreads()
    cv2.setNumThreads(-1)
    default: int = cv2.getNumThreads()
    cv2.setNumThreads(current)
    return default


def _read_threads(torch: Any) -> int:
    # A thread that limits them has imported torch, and has yet to say its number.
    for thread in threading.enumerate():
        if thread.name == LIMITING:
            thread.join()
    count: int = torch.get_num_threads()
    return count


_SETTINGS = (
    _Setting("the current folder", "os", lambda m: m.getcwd(), lambda m, value: m.chdir(value)),
    _Setting(
        "the environment", "os", _read_environment, _restore_environment, describe=_changed_names
    ),
    _Setting(
        "OpenCV's threads",
        "cv2",
        lambda m: m.getNumThreads(),
        lambda m, value: m.setNumThreads(value),
        _default_opencv_threads,
    ),
    _Setting(
        "torch's default dtype",
        "torch",
        lambda m: m.get_default_dtype(),
        lambda m, value: m.set_default_dtype(value),
        lambda m: m.float32,
    ),
    _Setting("torch's threads", "torch", _read_threads, lambda m, value: m.set_num_threads(value)),
)
