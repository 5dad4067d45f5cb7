"""Keep the two settings of the process by which plugins change results of others without a trace:
the working folder and torch's default dtype.

What a plugin changes is restored and reported. The conformance kit finds other settings.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def restored_process_state() -> Iterator[list[str]]:
    """Restore the settings at the end of the block.

    Yields:
        A list that holds the end of a sentence for each change after the block.
    """
    before = [read() for _, read, _ in _SETTINGS]
    changes = list[str]()
    try:
        yield changes
    finally:
        for (name, read, write), old in zip(_SETTINGS, before, strict=True):
            new = read()
            if old not in (None, new):
                end = "restored" if _write(write, old) else "not restored: results may differ"
                changes.append(
                    f"changed {name} ({old} -> {new}) of the whole process; it was {end}"
                )


def _write(write: Callable[[Any], object], value: Any) -> bool:
    try:
        write(value)
    except OSError:  # a folder that is gone
        return False
    return True


def _folder() -> str | None:
    try:
        return os.getcwd()
    except OSError:
        return None


def _default_dtype() -> str:
    """Return torch's default dtype; until torch is imported, the one that it begins with."""
    torch = sys.modules.get("torch")
    read = getattr(torch, "get_default_dtype", None)  # another thread may be importing torch
    return "torch.float32" if read is None else str(read())


def _set_default_dtype(name: str) -> None:
    import torch

    torch.set_default_dtype(getattr(torch, name.removeprefix("torch.")))


_SETTINGS: tuple[tuple[str, Callable[[], str | None], Callable[[str], object]], ...] = (
    ("the current folder", _folder, os.chdir),
    ("torch's default dtype", _default_dtype, _set_default_dtype),
)
