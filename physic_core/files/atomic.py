"""Writes of files of a folder: each file appears completely or not at all, also if the process is killed.

New files are written under temporary names and renamed at the end. A folder is locked while it is written, where its
file system has locks. What a process that was killed has left there is deleted by the next write with a lock.
"""

from __future__ import annotations

import errno
import os
import re
import secrets
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from physic_core.errors import OutputError

# As no other program names its files.
_PART = re.compile(r"\.(?:.+\.)?[0-9a-f]{8}\.physic-part", re.DOTALL)


class AtomicWrite:
    """Files of one folder that will be renamed together.

    Called with a file name, it returns the temporary path to write that file to.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._token = folder, secrets.token_hex(4)
        self._parts: dict[str, Path] = {}

    def __call__(self, name: str) -> Path:
        """Return the temporary path of a file."""
        # In the same folder, since a rename is atomic only within one file system.
        return self._parts.setdefault(name, self._folder / f".{name}.{self._token}.physic-part")

    def rename(self) -> None:
        """Give the files that were written so far their names, in the order of the calls."""
        for name, part in self._parts.items():
            os.replace(part, self._folder / name)
        self._parts.clear()

    def clean(self) -> None:
        """Delete the files that have no names."""
        for part in self._parts.values():
            with suppress(OSError):
                part.unlink(missing_ok=True)


@contextmanager
def atomic_write(folder: Path) -> Iterator[AtomicWrite]:
    """Yield a function from a file name to a temporary path; on success, rename all temporary files.

    The folder is locked meanwhile: another write waits. Each file is atomic, and not all of them together.

    Args:
        folder: of the files; it must exist.

    Raises:
        OutputError: the folder cannot be written, the disk is full, or a folder has the name of a file.
    """
    folder = Path(folder)
    write = AtomicWrite(folder)
    try:
        with _locked(folder) as is_locked:
            if is_locked:  # else the files can be of another process that writes now
                _clean(folder)
            try:
                yield write
                write.rename()
            finally:
                write.clean()
    except OSError as error:
        raise _refusal(folder, error) from error


def check_writable(folder: str | os.PathLike[str]) -> Path:
    """Create a folder if missing, and raise OutputError if it cannot be written.

    Returns:
        The folder.

    Raises:
        OutputError: it is a file, or cannot be created or written.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".{secrets.token_hex(4)}.physic-part"
        try:
            probe.write_bytes(b"")
        finally:
            probe.unlink(missing_ok=True)
    except OSError as error:
        raise _refusal(folder, error) from error
    return folder


@contextmanager
def _locked(folder: Path) -> Iterator[bool]:
    """Lock a folder against other processes and threads; yield False where folders have no locks, as on Windows."""
    if sys.platform == "win32":
        yield False
        return
    import fcntl

    file = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(file, fcntl.LOCK_EX)
        except OSError:  # some network file systems have none
            yield False
        else:
            yield True
    finally:
        with suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_UN)  # at once: a process that was forked meanwhile has the folder open too
        os.close(file)


def _clean(folder: Path) -> None:
    """Delete temporary files that a process left when it was killed."""
    with os.scandir(folder) as entries:
        for entry in entries:
            if _PART.fullmatch(entry.name):
                with suppress(OSError):
                    os.unlink(entry.path)


_REMEDY = {
    errno.EACCES: ", or check who may write there",
    errno.EPERM: ", or check who may write there",
    errno.ENOSPC: ", or free space there",
}


def _refusal(folder: Path, error: OSError) -> OutputError:
    if os.path.isfile(folder):  # Path's own raises where the way there is closed
        return OutputError(f"cannot write results to {folder}: it is a file; name a folder, or move the file away")
    # Of a file system such as /proc, "No such file or directory" is about the folder that is to be made.
    why = "no folder can be made there" if error.errno == errno.ENOENT else error.strerror or error
    return OutputError(
        f"cannot write results to {folder}: {why}; name another folder{_REMEDY.get(error.errno or 0, '')}"
    )
