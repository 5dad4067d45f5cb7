"""Cache folder with a maximum size; the least recently used files are deleted first."""

from __future__ import annotations

import os
import shutil
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

RESULT_SUFFIX = ".answer.npz"
"""Suffix of cached backend results; files without the suffix of a cache are never deleted."""
MAP_SUFFIX = ".map.npz"
"""Suffix of cached mesh correspondences (:mod:`physic_core.cache.correspondences`)."""
GRAPH_SUFFIX = ".graph.onnx"
"""Suffix of optimised graphs of networks (:mod:`physic_core.adapters.optimised_graphs`)."""
HASH_SUFFIX = ".sha256"
"""Suffix of SHA-256s of the user's files (:mod:`physic_core.cache.file_hashes`)."""
CACHE_SUFFIXES = (RESULT_SUFFIX, MAP_SUFFIX, GRAPH_SUFFIX, HASH_SUFFIX)
"""Suffixes of all caches."""

_INCOMPLETE_AGE_S = 3600.0
"""Age after which an incomplete file is deleted, s."""


@dataclass(frozen=True)
class CacheFile:
    """Path, size in bytes, and time of the last use (s since the epoch) of a cache file."""

    path: Path
    size: int
    used: float


def list_files(folder: Path, suffix: str = RESULT_SUFFIX) -> list[CacheFile]:
    """List the cache files of ``folder``, least recently used first; empty if the folder does not exist."""
    return sorted(_files(folder, f"[!.]*{suffix}"), key=lambda file: (file.used, file.path))


def mark_used(path: Path) -> None:
    """Set the last use of a cache file to now."""
    with suppress(OSError):
        os.utime(path)


def trim_folder(folder: Path, limit: int, suffix: str = RESULT_SUFFIX) -> None:
    """Delete old incomplete files, then the least recently used files beyond ``limit`` bytes."""
    for file in _incomplete_files(folder, suffix):
        if file.used < time.time() - _INCOMPLETE_AGE_S:
            _remove(file)
    files = list_files(folder, suffix)
    total = sum(file.size for file in files)
    for file in files:
        if total <= limit:
            break
        _remove(file)
        total -= file.size


def clear_folder(folder: Path, suffix: str = RESULT_SUFFIX) -> list[CacheFile]:
    """Delete all cache files of a folder and return the deleted ones."""
    for file in _incomplete_files(folder, suffix):
        _remove(file)
    return [file for file in list_files(folder, suffix) if _remove(file)]


def _incomplete_files(folder: Path, suffix: str) -> list[CacheFile]:
    return _files(folder, f".*{suffix}.*.physic-part")


def _files(folder: Path, pattern: str) -> list[CacheFile]:
    files = []
    with suppress(OSError):
        for path in folder.glob(pattern):
            with suppress(OSError):  # another process may delete it
                status = path.stat()
                files.append(CacheFile(path, status.st_size, status.st_mtime))
    return files


def _remove(file: CacheFile) -> bool:
    try:
        if file.path.is_dir():  # an incomplete file with its parts
            shutil.rmtree(file.path)
        else:
            file.path.unlink()
    except OSError:
        return False
    return True
