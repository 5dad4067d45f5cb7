"""Locks between processes and threads; a lock ends with the process that holds it, however that ends."""

from __future__ import annotations

import errno
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

__all__ = ["LockTimeoutError", "lock_folder", "try_lock", "unlock"]

LOCK_FILE = ".physic.lock"
"""Locked in place of the folder where folders cannot be locked: on Windows, and on network file systems."""

_POLL_S = 0.01
_HELD = (errno.EACCES, errno.EAGAIN, errno.EWOULDBLOCK, errno.EDEADLK)


class LockTimeoutError(Exception):
    """Raised if another process or thread holds a lock for too long."""


@contextmanager
def lock_folder(folder: Path, wait_s: float) -> Iterator[bool]:
    """Lock a folder against all others that lock it, and yield whether the file system has locks.

    Args:
        folder: must exist.
        wait_s: how long to wait for others, s.

    Raises:
        LockTimeoutError: another process or thread holds the lock.
        OSError: the folder cannot be opened.
    """
    end = time.monotonic() + wait_s
    while (lock := _try_folder(folder)) is None:
        if time.monotonic() > end:
            raise LockTimeoutError
        time.sleep(_POLL_S)
    file, path, is_locked = lock
    try:
        yield is_locked
    finally:
        _release(file, path)


def try_lock(file: int) -> bool | None:
    """Lock an open file for this process.

    Returns:
        True if it is locked now, False if another holds the lock, None if it cannot be locked at all.
    """
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(file, 0, os.SEEK_SET)
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return False if error.errno in _HELD else None
    return True


def unlock(file: int) -> None:
    """End a lock at once: a process that was forked meanwhile has the file open too."""
    with suppress(OSError):
        if sys.platform == "win32":
            import msvcrt

            os.lseek(file, 0, os.SEEK_SET)
            msvcrt.locking(file, msvcrt.LK_UNLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_UN)


def _try_folder(folder: Path) -> tuple[int, Path | None, bool] | None:
    """Return an open file, its path if it is a lock file, and whether it is locked; None if another has the lock."""
    if sys.platform != "win32":
        file = os.open(folder, os.O_RDONLY)
        if (state := try_lock(file)) is not None:
            return _held(file, None, state)
        os.close(file)
    path = folder / LOCK_FILE
    file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    state = try_lock(file)
    # The holder before deletes the file: whoever waited for that one holds nothing.
    if state and sys.platform != "win32" and os.fstat(file).st_nlink == 0:
        state = False
    return _held(file, path, state)


def _held(file: int, path: Path | None, state: bool | None) -> tuple[int, Path | None, bool] | None:
    if state is False:
        os.close(file)
        return None
    return file, path, state is True


def _release(file: int, path: Path | None) -> None:
    if path is not None and sys.platform != "win32":
        with suppress(OSError):
            path.unlink()
    unlock(file)
    os.close(file)
    if path is not None and sys.platform == "win32":
        with suppress(OSError):  # the next holder has it open
            path.unlink()
