"""Writes of one or several files of a folder that happen completely or not at all.

New files are written under temporary names and synchronised with the disk. Then one file, ``.physic-commit``, lists
what is to be renamed and deleted: from here on the write has happened. Whoever finds it, the same process or the next
one that writes there, renames and deletes the rest; who only reads takes the temporary files in it for the real ones
(:func:`committed_path`). Old files are deleted before new ones are renamed, so that no old one is beside a new one.

A folder is locked while it is written. What a process that was killed has left there is deleted by the next write.
"""

from __future__ import annotations

import errno
import json
import os
import re
import secrets
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from physic_core.errors import OutputError
from physic_core.files.locks import LockTimeoutError, lock_folder
from physic_core.files.regular import read_regular

__all__ = [
    "COMMIT_FILE",
    "AtomicWrite",
    "atomic_write",
    "check_writable",
    "committed_path",
    "finish_interrupted_write",
    "read_while_written",
    "sync_folder",
]

T = TypeVar("T")

COMMIT_FILE = ".physic-commit"

_WAIT_S = 120.0
_READ_AGAIN_S = 10.0
_PAUSE_S = 0.002
_MAX_COMMIT_BYTES = 1 << 20
_PART = re.compile(r"\.(?:.+\.)?[0-9a-f]{8}\.physic-part", re.DOTALL)  # as no other program calls its files
_OLD_S = 3600.0  # of a temporary file where nothing can be locked


@dataclass
class AtomicWrite:
    """Files of one folder that will be written and deleted together.

    Called with a file name, it returns the temporary path to write that file to.
    """

    folder: Path
    _token: str = field(default_factory=lambda: secrets.token_hex(4))
    _parts: dict[str, Path] = field(default_factory=dict)
    _removed: dict[str, list[int]] = field(default_factory=dict)
    _committing: bool = False

    def __call__(self, name: str) -> Path:
        """Return the temporary path of a file."""
        # In the same folder, since a rename is atomic only within one file system.
        return self._parts.setdefault(name, self.folder / _part_name(name, self._token))

    def remove(self, name: str) -> None:
        """Delete a file when the others are renamed, unless it changes until then."""
        with suppress(OSError):
            self._removed[name] = _identity(self.folder / name)

    def commit(self, durable: bool) -> None:
        """Rename and delete; see the module."""
        for name, path in self._parts.items():
            if os.path.isdir(self.folder / name) and not os.path.islink(self.folder / name):
                taken = self.folder / name
                raise OutputError(f"cannot write {taken}: a folder has this name; remove it, or move it away")
            if durable:
                _sync_file(path)
        if len(self._parts) == 1 and not self._removed:
            ((name, path),) = self._parts.items()
            os.replace(path, self.folder / name)
        elif self._parts or self._removed:
            listed = {
                "rename": {name: path.name for name, path in self._parts.items()},
                "delete": {name: identity for name, identity in self._removed.items() if name not in self._parts},
            }
            part = self(COMMIT_FILE)
            part.write_bytes(json.dumps(listed).encode())
            if durable:
                _sync_file(part)
            self._committing = True
            os.replace(part, self.folder / COMMIT_FILE)
            if durable:
                sync_folder(self.folder)
            _finish(self.folder, durable)
            return
        if durable:
            sync_folder(self.folder)

    def clean(self) -> None:
        """Delete the temporary files, unless the write has happened and waits for its end."""
        if self._committing and os.path.lexists(self.folder / COMMIT_FILE):
            return
        for path in self._parts.values():
            with suppress(OSError):
                path.unlink(missing_ok=True)


@contextmanager
def atomic_write(folder: Path, *, durable: bool = True) -> Iterator[AtomicWrite]:
    """Yield a function from a file name to a temporary path; on success, rename all temporary files.

    The folder is locked meanwhile, and an earlier write that was interrupted is finished first.

    Args:
        folder: of the files; it must exist.
        durable: whether to wait until the files are on the disk, so that they survive a loss of power.

    Raises:
        OutputError: the folder cannot be written, the disk is full, a folder has the name of a file, or another
            process writes there for two minutes.
    """
    folder = Path(folder)
    try:
        with lock_folder(folder, _WAIT_S) as is_locked:
            _finish(folder, durable)
            _clean(folder, 0.0 if is_locked else _OLD_S)
            write = AtomicWrite(folder)
            try:
                yield write
                write.commit(durable)
            finally:
                write.clean()
    except LockTimeoutError:
        raise OutputError(
            f"cannot write to {folder}: another process has been writing there for {_WAIT_S:.0f} s; "
            "wait for its end, or name another folder"
        ) from None
    except OSError as error:
        raise _refusal(folder, error) from error


def finish_interrupted_write(folder: Path) -> None:
    """Rename and delete what an interrupted write has left to do; a folder without one is not touched.

    Raises:
        OutputError: as for :func:`atomic_write`.
    """
    if os.path.lexists(folder / COMMIT_FILE):
        with atomic_write(folder):
            pass


def committed_path(folder: Path, name: str) -> Path:
    """Return where a file of a folder is: its own path, or the temporary one of a write that waits for its end."""
    part = _read_commit(folder)[0].get(name)
    return folder / part if part and os.path.lexists(folder / part) else folder / name


def read_while_written(folder: Path, name: str, read: Callable[[], T]) -> T:
    """Call a function that reads several files of a folder, again if it fails and ``name`` was written meanwhile.

    Raises:
        Exception: whatever the function raised while nothing was written.
    """
    end = time.monotonic() + _READ_AGAIN_S
    while True:
        before = _state(folder, name)
        try:
            return read()
        except Exception:
            if _state(folder, name) == before or time.monotonic() > end:
                raise
        time.sleep(_PAUSE_S)


def check_writable(folder: str | os.PathLike[str]) -> Path:
    """Create a folder if missing, and raise OutputError if it cannot be written.

    Returns:
        The folder.

    Raises:
        OutputError: it is a file, or cannot be created or written.
    """
    folder = Path(folder)
    try:
        new = [part for part in (folder, *folder.parents) if not os.path.lexists(part)]
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".{secrets.token_hex(4)}.physic-part"
        try:
            probe.write_bytes(b"")
        finally:
            probe.unlink(missing_ok=True)
        for part in new:
            sync_folder(part.parent)
    except OSError as error:
        raise _refusal(folder, error) from error
    return folder


def sync_folder(folder: Path) -> None:
    """Wait until renames in a folder are on the disk, where the system can."""
    if sys.platform == "win32":
        return
    file = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # some network file systems refuse it for folders
            os.fsync(file)
    finally:
        os.close(file)


def _part_name(name: str, token: str) -> str:
    return f".{name}.{token}.physic-part"


def _identity(path: Path) -> list[int]:
    status = os.lstat(path)
    return [status.st_size, status.st_mtime_ns]


def _state(folder: Path, name: str) -> tuple[object, ...]:
    def identity(path: Path) -> tuple[int, ...]:
        try:
            status = os.stat(path)
        except OSError:
            return ()
        return status.st_ino, status.st_size, status.st_mtime_ns

    return identity(folder / COMMIT_FILE), identity(folder / name)


def _read_commit(folder: Path) -> tuple[dict[str, str], dict[str, list[int]]]:
    """Return what is to be renamed and deleted; names that no write of ours would list are left out."""
    try:
        listed: Any = json.loads(read_regular(folder / COMMIT_FILE, _MAX_COMMIT_BYTES))
        rename, delete = dict(listed["rename"]), dict(listed["delete"])
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return {}, {}
    return (
        {name: part for name, part in rename.items() if _is_name(name) and _is_part_of(part, name)},
        {name: identity for name, identity in delete.items() if _is_name(name)},
    )


def _is_name(name: str) -> bool:
    return os.path.basename(name) == name and name not in ("", ".", "..") and "\0" not in name


def _is_part_of(part: object, name: str) -> bool:
    return (
        isinstance(part, str) and re.fullmatch(re.escape(f".{name}.") + r"[0-9a-f]{8}\.physic-part", part) is not None
    )


def _finish(folder: Path, durable: bool) -> None:
    """Rename and delete what a write that has happened has listed; it may have done a part of it."""
    if not os.path.lexists(folder / COMMIT_FILE):
        return
    rename, delete = _read_commit(folder)
    for name, identity in delete.items():
        with suppress(FileNotFoundError):
            if _identity(folder / name) == identity:
                os.unlink(folder / name)
    waiting = [name for name, part in rename.items() if os.path.lexists(folder / part)]
    for name in waiting:
        if name != next(iter(rename)):  # the first one marks the folder for readers
            with suppress(FileNotFoundError):
                os.unlink(folder / name)
    for name in waiting:
        os.replace(folder / rename[name], folder / name)
    if durable:
        sync_folder(folder)
    os.unlink(folder / COMMIT_FILE)


def _clean(folder: Path, age_s: float) -> None:
    """Delete temporary files that a process left when it was killed."""
    with os.scandir(folder) as entries:
        for entry in entries:
            if _PART.fullmatch(entry.name):
                with suppress(OSError):
                    if age_s == 0 or entry.stat(follow_symlinks=False).st_mtime < time.time() - age_s:
                        os.unlink(entry.path)


def _sync_file(path: Path) -> None:
    """Wait until a file is on the disk."""
    with open(path, "rb+") as file:
        if sys.platform == "darwin":
            import fcntl

            fcntl.fcntl(file, fcntl.F_FULLFSYNC)  # fsync leaves it in the memory of the drive
        else:
            os.fsync(file.fileno())


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
