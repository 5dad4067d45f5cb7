"""The folder of a running server, which is deleted when the server ends, or by the next one if it was killed."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

_PREFIX, _LOCK, _CONTENT = "physic-serve-", "lock", "jobs"


@contextmanager
def server_folder(parent: Path) -> Iterator[Path]:
    """Yield a new folder that only this user can read, and delete it and those of killed servers.

    Raises:
        OSError: the folder cannot be made.
    """
    _delete_abandoned(parent)
    place = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=parent))
    try:
        with FileLock(place / _LOCK):
            content = place / _CONTENT
            content.mkdir()  # after the lock: a folder without it is of a server that starts
            yield content
    finally:
        shutil.rmtree(place, ignore_errors=True)


def _delete_abandoned(parent: Path) -> None:
    for place in parent.glob(f"{_PREFIX}*"):
        # Servers of other users lock files in folders of their own.
        if place.is_symlink() or not (place / _CONTENT).is_dir() or place.stat().st_uid != _user():
            continue
        with suppress(Timeout, OSError), FileLock(place / _LOCK, blocking=False):
            shutil.rmtree(place, ignore_errors=True)


def _user() -> int:
    return os.getuid() if hasattr(os, "getuid") else 0  # 0 is what stat() gives on Windows
