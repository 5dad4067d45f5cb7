"""Folders of caches: where they are, that only their user writes there, and their maximum size."""

from __future__ import annotations

import logging
import os
import re
import shutil
import stat
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

CACHE_VARIABLE = "PHYSIC_CACHE"
"""Environment variable with the folder of all caches, or "off"."""

CACHES = {
    "results": ("results", ".result.npz"),
    "correspondences": ("maps", ".map.npz"),
    "graphs": ("graphs", ".graph.onnx"),
    "hashes": ("hashes", ".sha256"),
    "kit": ("kit", ".passed"),
}
"""Folder and suffix of each cache: results of backends, correspondences of meshes, optimised graphs
of networks, SHA-256s of the user's files, and stamps of backends that passed the conformance kit.
"""

_INCOMPLETE_AGE_S = 3600.0
"""Age after which an incomplete file is deleted, s."""

_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
_ADVICE = f"name a folder of your own in {CACHE_VARIABLE}"


@dataclass(frozen=True)
class CacheFile:
    """Path, size in bytes, and time of the last use (s since the epoch) of a cache file."""

    path: Path
    size: int
    used_at: float

    def delete(self) -> bool:
        """Delete the file, and return whether that was possible."""
        try:
            if self.path.is_dir():  # an incomplete file with its parts
                shutil.rmtree(self.path)
            else:
                self.path.unlink()
        except OSError:
            return False
        return True


@dataclass(frozen=True)
class LruFolder:
    """The files of one cache in a folder.

    Attributes:
        path: of the folder, which need not exist.
        suffix: of the files; other files are never deleted.
    """

    path: Path
    suffix: str

    def files(self) -> list[CacheFile]:
        """Return the files, least recently used first."""
        return sorted(
            self._matching(f"[!.]*{self.suffix}"), key=lambda file: (file.used_at, file.path)
        )

    def mark_used(self, name: str) -> None:
        """Set the last use of a file to now."""
        with suppress(OSError):
            os.utime(self.path / name)

    def trim(self, limit: int) -> None:
        """Delete old incomplete files, then the least recently used files beyond ``limit``
        bytes.
        """
        for file in self._incomplete():
            if file.used_at < time.time() - _INCOMPLETE_AGE_S:
                file.delete()
        files = self.files()
        total = sum(file.size for file in files)
        for file in files:
            if total <= limit:
                break
            file.delete()
            total -= file.size

    def clear(self) -> list[CacheFile]:
        """Delete all files and return the deleted ones."""
        for file in self._incomplete():
            file.delete()
        return [file for file in self.files() if file.delete()]

    def _incomplete(self) -> list[CacheFile]:
        return self._matching(f".*{self.suffix}.*.physic-part")

    def _matching(self, pattern: str) -> list[CacheFile]:
        files = []
        with suppress(OSError):
            for path in self.path.glob(pattern):
                with suppress(OSError):  # another process may delete it
                    status = path.stat()
                    files.append(CacheFile(path, status.st_size, status.st_mtime))
        return files


def cache_folder(name: str, variable: str = "") -> Path | None:
    """Return the folder of a cache; None if it is disabled or the user has no home folder.

    Args:
        name: of the cache.
        variable: environment variable with another folder, or "off"; "" for none.
    """
    setting = os.environ.get(variable, "") if variable else ""
    if setting.lower() in ("off", "0", "no", "false"):
        return None
    if setting:
        return Path(setting)
    base = os.environ.get("XDG_CACHE_HOME", "")
    if not os.path.isabs(base):  # the XDG standard ignores relative paths
        try:
            home = Path.home()
        except RuntimeError:
            return None
        if sys.platform == "win32":
            base = os.environ.get("LOCALAPPDATA") or str(home / "AppData" / "Local")
        else:
            base = str(home / ("Library/Caches" if sys.platform == "darwin" else ".cache"))
    return Path(base) / "physic" / name


def plain_name(text: str) -> str:
    """Convert the name of a backend, a network or a mesh to a part of a file name."""
    return re.sub(r"[^\w.-]+", "_", text)[:60]


def users_cache(name: str) -> LruFolder | None:
    """Return a cache of :data:`CACHES`; None if it is disabled."""
    folder, suffix = CACHES[name]
    root = cache_folder("", CACHE_VARIABLE)
    return None if root is None else LruFolder(root / folder, suffix)


def claim_folder(folder: Path | None) -> Path | None:
    """Create a cache folder that only its user can open, or check that no one else can write to an
    existing one.

    A folder of the user that others can write is closed to them, and its cache files are deleted,
    since others may have written them. A folder of another user is not used. One warning per
    process says so. Windows is not checked.

    Returns:
        The folder, which does not exist if it cannot be created. None for None, and if the folder
        must not be used.
    """
    if folder is None:
        return None
    with suppress(OSError):  # the first write says why
        for missing in reversed(
            [path for path in (folder, *folder.parents) if not os.path.exists(path)]
        ):
            missing.mkdir(mode=stat.S_IRWXU, exist_ok=True)
    if sys.platform == "win32" or not os.path.exists(folder):
        return folder
    if folder.stat().st_uid != os.geteuid():
        _warn_of_cache(
            f"the cache in {folder.parent} is not used, since it belongs to another user: {_ADVICE}"
        )
        return None
    if folder.stat().st_mode & _OTHERS_WRITE:
        with suppress(OSError):  # the next line finds out
            folder.chmod(stat.S_IRWXU)
        if folder.stat().st_mode & _OTHERS_WRITE:
            _warn_of_cache(
                f"the cache in {folder.parent} is not used, since others can write to it: {_ADVICE}"
            )
            return None
        for _, suffix in CACHES.values():
            LruFolder(folder, suffix).clear()
        _warn_of_cache(
            f"others could write to the cache in {folder.parent}: now only you can, and its "
            f"content was discarded"
        )
    return folder


def claimed_cache(name: str) -> LruFolder | None:
    """Return a cache of the user after :func:`claim_folder`; None if it is disabled or must not be
    used.
    """
    cache = users_cache(name)
    return None if cache is None or claim_folder(cache.path) is None else cache


def belongs_to_user(path: Path) -> bool:
    """Return whether a file or folder belongs to the user, which is not checked on Windows; False
    if it is gone.
    """
    try:
        return sys.platform == "win32" or path.stat().st_uid == os.geteuid()
    except OSError:
        return False


@cache
def _warn_of_cache(message: str) -> None:
    """Log a warning once in a process."""
    logging.getLogger(__name__).warning(message)
