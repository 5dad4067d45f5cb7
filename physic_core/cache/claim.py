"""Claim a cache folder for its user, so that no one else can have written what is read from it."""

from __future__ import annotations

import logging
import os
import stat
import sys
from contextlib import suppress
from functools import cache
from typing import TYPE_CHECKING

from physic_core.cache.folders import CACHE_VARIABLE, CACHES, users_cache
from physic_core.cache.lru_folder import LruFolder

if TYPE_CHECKING:
    from pathlib import Path

_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
_ADVICE = f"name a folder of your own in {CACHE_VARIABLE}"


def claim_folder(folder: Path | None) -> Path | None:
    """Create a cache folder that only its user can open, or check that no one else can write to an existing one.

    A folder of the user that others can write is closed to them, and its cache files are deleted, since others may
    have written them. A folder of another user is not used. One warning per process says so. Windows is not checked.

    Returns:
        The folder, which does not exist if it cannot be created. None for None, and if the folder must not be used.
    """
    if folder is None:
        return None
    with suppress(OSError):  # the first write says why
        for missing in reversed([path for path in (folder, *folder.parents) if not os.path.exists(path)]):
            missing.mkdir(mode=stat.S_IRWXU, exist_ok=True)
    if sys.platform == "win32" or not os.path.exists(folder):
        return folder
    if folder.stat().st_uid != os.geteuid():
        _warn(f"the cache in {folder.parent} is not used, since it belongs to another user: {_ADVICE}")
        return None
    if folder.stat().st_mode & _OTHERS_WRITE:
        with suppress(OSError):  # the next line finds out
            folder.chmod(stat.S_IRWXU)
        if folder.stat().st_mode & _OTHERS_WRITE:
            _warn(f"the cache in {folder.parent} is not used, since others can write to it: {_ADVICE}")
            return None
        for _, suffix in CACHES.values():
            LruFolder(folder, suffix).clear()
        _warn(f"others could write to the cache in {folder.parent}: now only you can, and its content was discarded")
    return folder


def claimed_cache(name: str) -> LruFolder | None:
    """Return a cache of the user after :func:`claim_folder`; None if it is disabled or must not be used."""
    found = users_cache(name)
    return None if found is None or claim_folder(found.path) is None else found


def is_own(path: Path) -> bool:
    """Return whether a file or folder belongs to the user, which is not checked on Windows; False if it is gone."""
    try:
        return sys.platform == "win32" or path.stat().st_uid == os.geteuid()
    except OSError:
        return False


@cache
def _warn(message: str) -> None:
    """Log a warning once in a process."""
    logging.getLogger(__name__).warning(message)
