"""Locks of folders between processes and threads; a lock ends with the process that holds it, however that ends."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path

from filelock import FileLock, Timeout, lock_descriptor, unlock_descriptor

LOCK_FILE = ".physic.lock"
"""Locked in place of the folder where folders cannot be locked: on Windows, and on network file systems."""

_POLL_S = 0.01


@contextmanager
def lock_folder(folder: Path, wait_s: float) -> Iterator[bool]:
    """Lock a folder against all others that lock it, and yield whether it is locked: some file systems have no locks.

    Args:
        folder: must exist.
        wait_s: how long to wait for others, s.

    Raises:
        filelock.Timeout: another process or thread holds the lock.
        OSError: the folder cannot be opened.
    """
    if sys.platform == "win32":
        with FileLock(folder / LOCK_FILE, timeout=wait_s):
            yield True
        return
    file = os.open(folder, os.O_RDONLY)
    try:
        end = time.monotonic() + wait_s
        while (is_locked := _try_lock(file)) is False:
            if time.monotonic() > end:
                raise Timeout(str(folder))
            time.sleep(_POLL_S)
        with _lock_file(folder, wait_s) if is_locked is None else nullcontext(True) as is_locked:
            yield is_locked
    finally:
        with suppress(OSError):
            unlock_descriptor(file)  # at once: a process that was forked meanwhile has the folder open too
        os.close(file)


@contextmanager
def _lock_file(folder: Path, wait_s: float) -> Iterator[bool]:
    lock = FileLock(folder / LOCK_FILE, timeout=wait_s)
    try:
        lock.acquire()
    except Timeout:
        raise
    except OSError:  # the first write says why, if files cannot be made there either
        pass
    try:
        yield lock.is_locked
    finally:
        lock.release()


def _try_lock(folder: int) -> bool | None:
    """Lock an open folder; False if another has the lock, None if the file system locks no folders."""
    try:
        return lock_descriptor(folder, blocking=False)
    except OSError:
        return None
