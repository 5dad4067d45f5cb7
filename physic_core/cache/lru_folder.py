"""A folder of cache files with a maximum size; the least recently used file is deleted first."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

__all__ = [
    "MAP_SUFFIX",
    "MODEL_SUFFIX",
    "RESULT_SUFFIX",
    "CacheFile",
    "clear_folder",
    "list_files",
    "mark_used",
    "trim_folder",
]

RESULT_SUFFIX = ".answer.npz"
"""Suffix of cached backend outputs. A cache never touches a file without its suffix."""
MAP_SUFFIX = ".map.npz"
"""Of those that keep maps between the meshes of bodies (:mod:`physic_core.cache.maps`)."""
MODEL_SUFFIX = ".model.pkl"
"""Of plain copies of the user's body models (:mod:`physic_core.adapters.plain_models`)."""

_LEFT_OVER_S = 3600.0
"""A half-written file of this age, s, has no writer any more."""


@dataclass(frozen=True)
class CacheFile:
    """One cache file.

    Attributes:
        path: of the file.
        size: bytes.
        used: when it was last written or read, s since the epoch.
    """

    path: Path
    size: int
    used: float


def list_files(folder: Path, suffix: str = RESULT_SUFFIX) -> list[CacheFile]:
    """List the cache files of ``folder``, least recently used first; empty if there is no such folder."""
    return sorted(_files(folder, f"[!.]*{suffix}"), key=lambda file: (file.used, file.path))


def mark_used(path: Path) -> None:
    """Mark a file as used now."""
    with suppress(OSError):
        os.utime(path)


def trim_folder(folder: Path, limit: int, suffix: str = RESULT_SUFFIX) -> None:
    """Delete leftovers of interrupted writes, then the least recently used files beyond ``limit`` bytes."""
    for file in _half_written(folder, suffix):
        if file.used < time.time() - _LEFT_OVER_S:
            _remove(file)
    files = list_files(folder, suffix)
    total = sum(file.size for file in files)
    for file in files:
        if total <= limit:
            break
        _remove(file)
        total -= file.size


def clear_folder(folder: Path, suffix: str = RESULT_SUFFIX) -> list[CacheFile]:
    """Delete all cache files of ``folder`` and return those that were deleted."""
    for file in _half_written(folder, suffix):
        _remove(file)
    return [file for file in list_files(folder, suffix) if _remove(file)]


def _half_written(folder: Path, suffix: str) -> list[CacheFile]:
    return _files(folder, f".*{suffix}.*.part")


def _files(folder: Path, pattern: str) -> list[CacheFile]:
    files = []
    with suppress(OSError):
        for path in folder.glob(pattern):
            with suppress(OSError):  # another process may remove it meanwhile
                status = path.stat()
                files.append(CacheFile(path, status.st_size, status.st_mtime))
    return files


def _remove(file: CacheFile) -> bool:
    try:
        file.path.unlink()
    except OSError:
        return False
    return True
