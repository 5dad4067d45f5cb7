"""Writes of files of a folder: each file appears completely or not at all.

New files are written under temporary names, synchronised with the disk, and renamed. Where one file, the index, lists
the digests of the others, these belong together: the old index is moved away first, and the new one is renamed last.
A folder without its index has no valid set of files. Files that are only added to a valid set are renamed before the
new index replaces the old one. Until a write has ended, old and new index stay in the folder under temporary names, so
that the next write knows which files are not of the user (:func:`interrupted_index_files`).

A folder is locked while it is written, where its file system has locks. What a process that was killed has left there
is deleted by the next write with a lock.
"""

from __future__ import annotations

import errno
import itertools
import os
import re
import secrets
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from filelock import Timeout

from physic_core.errors import OutputError
from physic_core.files.locks import lock_folder

_WAIT_S = 120.0
# As no other program names its files.
_PART = re.compile(r"\.(?:.+\.)?[0-9a-f]{8}\.physic-part", re.DOTALL)
_INDEX_PART = re.compile(r"\.(.+)\.[0-9a-f]{8}\.physic-index", re.DOTALL)


@dataclass
class AtomicWrite:
    """Files of one folder that will be written and deleted together.

    Called with a file name, it returns the temporary path to write that file to.
    """

    folder: Path
    index: str = ""
    index_stays: bool = False
    _token: str = field(default_factory=lambda: secrets.token_hex(4))
    _parts: dict[str, Path] = field(default_factory=dict)
    _removed: set[str] = field(default_factory=set)
    _kept: dict[str, str] = field(default_factory=dict)
    _is_begun: bool = False

    def __call__(self, name: str) -> Path:
        """Return the temporary path of a file."""
        # In the same folder, since a rename is atomic only within one file system.
        return self._parts.setdefault(name, self._part(name, self._token))

    def remove(self, name: str) -> None:
        """Delete a file before the others are renamed."""
        self._removed.add(name)

    def keep(self, name: str) -> None:
        """Rename a file of the user before the others are renamed: ``preview.png`` to ``preview.edited.png``."""
        stem, suffix = os.path.splitext(name)
        numbers = itertools.chain([""], map("-{}".format, itertools.count(2)))
        names = (f"{stem}.edited{number}{suffix}" for number in numbers)
        self._kept[name] = next(new for new in names if not os.path.lexists(self.folder / new))

    def commit(self, durable: bool) -> None:
        """Rename and delete, in the order of the calls, the index last; see the module."""
        for name, path in self._parts.items():
            is_folder = os.path.isdir(self.folder / name) and not os.path.islink(self.folder / name)
            if is_folder and name not in self._kept:
                taken = self.folder / name
                raise OutputError(f"cannot write {taken}: a folder has this name; remove it, or move it away")
            if durable:
                _sync_file(path)
        others = [name for name in self._parts if name != self.index]
        has_index = self.index in self._parts
        if has_index and (others or self._removed):
            self._is_begun = True
            if not self.index_stays and self.index not in self._kept:
                with suppress(FileNotFoundError):
                    os.replace(self.folder / self.index, self._part(self.index, secrets.token_hex(4)))
                self._sync(durable)
        for name, other in self._kept.items():
            os.rename(self.folder / name, self.folder / other)
        for name in self._removed.difference(others):
            (self.folder / name).unlink(missing_ok=True)
        for name in others:
            os.replace(self._parts[name], self.folder / name)
        self._sync(durable)
        if has_index:
            os.replace(self._parts[self.index], self.folder / self.index)
            self._sync(durable)
            for path in interrupted_index_files(self.folder, self.index):
                path.unlink(missing_ok=True)

    def clean(self) -> None:
        """Delete the temporary files, but no index that tells which files are not of the user."""
        for name, path in self._parts.items():
            if not (name == self.index and self._is_begun):
                with suppress(OSError):
                    path.unlink(missing_ok=True)

    def _part(self, name: str, token: str) -> Path:
        return self.folder / f".{name}.{token}.physic-{'index' if name == self.index else 'part'}"

    def _sync(self, durable: bool) -> None:
        if durable:
            sync_folder(self.folder)


@contextmanager
def atomic_write(
    folder: Path, *, index: str = "", index_stays: bool = False, durable: bool = True
) -> Iterator[AtomicWrite]:
    """Yield a function from a file name to a temporary path; on success, rename all temporary files.

    The folder is locked meanwhile. Without an index, each file is atomic, and not all of them together.

    Args:
        folder: of the files; it must exist.
        index: name of the file that lists the digests of the others; "" without one.
        index_stays: whether the old index stays valid until the new one replaces it: files are only added.
        durable: whether to wait until the files are on the disk, so that they survive a loss of power.

    Raises:
        OutputError: the folder cannot be written, the disk is full, a folder has the name of a file, or another
            process writes there for two minutes.
    """
    folder = Path(folder)
    try:
        with lock_folder(folder, _WAIT_S) as is_locked:
            if is_locked:  # else the files can be of another process that writes now
                _clean(folder)
            write = AtomicWrite(folder, index, index_stays)
            try:
                yield write
                write.commit(durable)
            finally:
                write.clean()
    except Timeout:
        raise OutputError(
            f"cannot write to {folder}: another process has been writing there for {_WAIT_S:.0f} s; "
            "wait for its end, or name another folder"
        ) from None
    except OSError as error:
        raise _refusal(folder, error) from error


def interrupted_index_files(folder: Path, index: str) -> list[Path]:
    """Return the old and new indices of writes that were interrupted; those that are not complete too."""
    with suppress(OSError), os.scandir(folder) as entries:
        named = ((entry.path, _INDEX_PART.fullmatch(entry.name)) for entry in entries)
        return [Path(path) for path, match in named if match and match[1] == index]
    return []


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


def _clean(folder: Path) -> None:
    """Delete temporary files that a process left when it was killed."""
    with os.scandir(folder) as entries:
        for entry in entries:
            if _PART.fullmatch(entry.name):
                with suppress(OSError):
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
