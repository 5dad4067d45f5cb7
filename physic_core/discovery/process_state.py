"""Keep the settings of the process by which plugins end the work of others, or change its results:
the working folder, NumPy's floating-point errors, and torch's dtype, device and gradients.

What a plugin changes is restored and reported. The conformance kit finds other settings.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any


@contextmanager
def restored_process_state() -> Iterator[list[str]]:
    """Restore the settings at the end of the block.

    Yields:
        A list that holds the end of a sentence for each change after the block.
    """
    before = [_value(read) for _, read, _ in _SETTINGS]
    changes = list[str]()
    try:
        yield changes
    finally:
        for (name, read, write), old in zip(_SETTINGS, before, strict=True):
            new = _value(read)
            if old not in (None, new):
                with suppress(OSError):  # a folder that is gone
                    write(old)
                end = "restored" if _value(read) == old else "not restored: results may differ"
                changes.append(
                    f"changed {name} ({old} -> {new}) of the whole process; it was {end}"
                )


def _value(read: Callable[[], Any]) -> Any:
    try:
        return read()
    except OSError:
        return None


def _torch(function: str, first: object = None) -> Any:
    """Return a setting of torch; until torch is imported, the one that it begins with."""
    # another thread may be importing torch
    read = getattr(sys.modules.get("torch"), function, lambda: first)
    return value if isinstance(value := read(), bool) else str(value)


def _set_dtype(name: str) -> None:
    import torch

    torch.set_default_dtype(getattr(torch, name.removeprefix("torch.")))


def _set_device(name: str) -> None:
    import torch

    torch.set_default_device(None if name == "cpu" else name)  # "cpu" would slow every call


def _set_gradients(are_kept: bool) -> None:
    import torch

    torch.set_grad_enabled(are_kept)


def _numpy_errors() -> dict[str, Any] | None:
    read = getattr(sys.modules.get("numpy"), "geterr", lambda: None)
    errors: dict[str, Any] | None = read()
    return errors


def _set_numpy_errors(errors: dict[str, Any]) -> None:
    import numpy as np

    np.seterr(**errors)


_SETTINGS: tuple[tuple[str, Callable[[], Any], Callable[[Any], object]], ...] = (
    ("the current folder", os.getcwd, os.chdir),
    ("torch's default dtype", lambda: _torch("get_default_dtype", "torch.float32"), _set_dtype),
    ("torch's default device", lambda: _torch("get_default_device", "cpu"), _set_device),
    ("torch's gradients", lambda: _torch("is_grad_enabled", True), _set_gradients),
    ("NumPy's floating-point errors", _numpy_errors, _set_numpy_errors),
)
