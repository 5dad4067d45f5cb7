"""Writes and reads of files: each file appears completely or not at all, also if the process is
killed.

New files are written under temporary names and renamed at the end. A folder is locked while it is
written, where its file system has locks. Temporary files of a killed process are deleted by the
next write with a lock.

Outside a result's folder, PhySIC replaces only files with its mark, and never writes through a
link. It reads only regular files, since reading a pipe could wait for ever.
"""

from __future__ import annotations

import errno
import logging
import os
import re
import secrets
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from io import BufferedReader
from pathlib import Path
from typing import BinaryIO

from physic_core.errors import InputError, OutputError
from physic_core.files.names import UntrustedName

MARK = "Written by PhySIC. The same command replaces this file."
"""Text in a file by which PhySIC knows later that it may replace the file."""

LOCK_WAIT_S = 600.0
"""Longest wait for another process that writes a folder, s."""

_SILENT_S = 5.0  # of that wait
_POLL_S = 0.05
_START_BYTES = 1 << 16  # that have the mark
# No other program names its files so.
_PART = re.compile(r"\..+\.[0-9a-f]{8}\.physic-part", re.DOTALL)
_LOG = logging.getLogger(__name__)


class AtomicWrite:
    """Files of one folder that will be renamed together.

    Called with a file name, it returns the temporary path to write that file to.

    Args:
        folder: of the files.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._token = secrets.token_hex(4)
        self._parts = dict[str, Path]()

    def __call__(self, name: str) -> Path:
        """Return the temporary path of a file.

        Raises:
            OutputError: the file would lie outside the folder.
        """
        _ = path_to_write(self._folder, name)
        # In the same folder, since a rename is atomic only within one file system.
        part = f".{name.replace('/', '.')}.{self._token}.physic-part"
        return self._parts.setdefault(name, self._folder / part)

    def rename(self) -> None:
        """Give the files their names, in the order of the calls.

        Raises:
            OSError: a file cannot be renamed.
        """
        for name, part in self._parts.items():
            (self._folder / name).parent.mkdir(parents=True, exist_ok=True)
            os.replace(part, self._folder / name)

    def clean(self) -> None:
        """Delete the files that were not renamed."""
        for part in self._parts.values():
            with suppress(OSError):
                part.unlink(missing_ok=True)


def path_to_write(folder: Path, name: str) -> Path:
    """Return the path of a file or folder that will be written in a folder.

    Raises:
        OutputError: it would lie outside.
    """
    try:
        return UntrustedName(name).inside(folder)
    except InputError as error:
        raise OutputError(
            f"cannot write {folder / name}: a link there leads out of {folder}; move the link "
            f"away, or name another folder"
        ) from error


def is_part(name: str) -> bool:
    """Return whether a file's name is that of a temporary file."""
    return _PART.fullmatch(name) is not None


@contextmanager
def atomic_write(folder: Path, *, lock: bool = True) -> Iterator[AtomicWrite]:
    """Yield a function from a file name to a temporary path; on success, rename all temporary
    files.

    The folder is locked meanwhile: another write waits. Each file is atomic, but the set of files
    is not.

    Args:
        folder: of the files; it must exist.
        lock: whether to lock it; False for files of which any version will do.

    Raises:
        OutputError: the folder cannot be written, the disk is full, a folder has the name of a
            file, or another process does not end its write.
    """
    folder = Path(folder)
    write = AtomicWrite(folder)
    try:
        with locked(folder) if lock else nullcontext(False) as is_locked:
            try:
                yield write
                write.rename()
            finally:
                write.clean()
                if is_locked:  # else the files can be of another process that writes now
                    _remove_incomplete(folder)
    except OSError as error:
        raise refusal(folder, error) from error


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
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise refusal(folder, error) from error
    return folder


@contextmanager
def locked(folder: Path) -> Iterator[bool]:
    """Lock a folder against other processes and threads; yield False where folders have no locks,
    as on Windows.

    A warning names the process that is waited for, if it takes seconds.

    Raises:
        TimeoutError: it still has the lock after :data:`LOCK_WAIT_S`.
        OSError: the folder cannot be opened.
    """
    if sys.platform == "win32":
        yield False
        return
    import fcntl

    file = os.open(folder, os.O_RDONLY)
    try:
        yield _lock(file, folder)
    finally:
        with suppress(OSError):
            # at once: a process that was forked meanwhile has the folder open too
            fcntl.flock(file, fcntl.LOCK_UN)
        os.close(file)


def _lock(file: int, folder: Path) -> bool:
    import fcntl

    start = time.monotonic()
    is_silent = True
    while True:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            waited = time.monotonic() - start
        except OSError:  # some network file systems have none
            return False
        else:
            return True
        if waited >= LOCK_WAIT_S:
            why = f"{_lock_holder(file)} has been writing there for {LOCK_WAIT_S:.0f} s"
            raise TimeoutError(errno.ETIMEDOUT, why, str(folder))
        if is_silent and waited >= _SILENT_S:
            is_silent = False
            _LOG.warning(
                "%s: waiting up to %.0f s for %s, which writes there",
                folder,
                LOCK_WAIT_S,
                _lock_holder(file),
            )
        time.sleep(_POLL_S)


def _lock_holder(file: int) -> str:
    """Return who has locked an open folder, as far as this machine knows."""
    with suppress(OSError):
        status = os.fstat(file)
        device = f"{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}"
        for line in Path("/proc/locks").read_text("ascii").splitlines():
            match line.split():
                case [_, "FLOCK", _, "WRITE", pid, place, *_] if (
                    place == f"{device}:{status.st_ino}"
                ):
                    return f"process {pid} of this machine"
    return "another process"


def _remove_incomplete(folder: Path) -> None:
    """Delete temporary files that a process left when it was killed."""
    with os.scandir(folder) as entries:
        for entry in entries:
            if is_part(entry.name):
                with suppress(OSError):
                    os.unlink(entry.path)


_REPLACED = "a file there was moved or replaced meanwhile, as if another process wrote there too"
_REMEDY = {
    errno.EACCES: ", or check who may write there",
    errno.EPERM: ", or check who may write there",
    errno.ENOSPC: ", or free space there",
    errno.ETIMEDOUT: ", or end or continue that process",
}


def refusal(folder: Path, error: OSError) -> OutputError:
    """Return the error for a folder that cannot be written."""
    if os.path.isfile(folder):  # Path.is_file raises if a parent folder cannot be entered
        return OutputError(
            f"cannot write results to {folder}: it is a file; name a folder, or move the file away"
        )
    why = error.strerror or error
    if error.errno == errno.ENOENT:
        # Of a file system such as /proc, it is about the folder that is to be made.
        why = _REPLACED if os.path.isdir(folder) else "no folder can be made there"
    return OutputError(
        f"cannot write results to {folder}: {why}; name another "
        f"folder{_REMEDY.get(error.errno or 0, '')}"
    )


def check_own(*paths: Path, mark: str = MARK) -> None:
    """Check that no file of the user would be replaced; call it before anything is computed.

    Args:
        paths: of the files that will be written.
        mark: text that the first 64 kB of these files contain, in UTF-8.

    Raises:
        OutputError: one of them exists, and is not a regular file with the mark; a link counts as a
            file of the user.
    """
    for path in paths:
        try:
            is_own = stat.S_ISREG(os.lstat(path).st_mode) and has_mark(path, mark)
        except FileNotFoundError:
            continue
        except OSError as error:
            raise OutputError(
                f"cannot write {path}: {error.strerror}; name another folder"
            ) from error
        if not is_own:
            raise foreign_file(path)


def write_own(path: Path, content: bytes, mark: str = MARK) -> Path:
    """Write a file that carries the mark, completely or not at all; an earlier one is replaced.

    Raises:
        OutputError: it cannot be written, or a file of the user is there.
    """
    check_own(path, mark=mark)
    with atomic_write(check_writable(path.parent)) as temporary:
        temporary(path.name).write_bytes(content)
    return path


def foreign_file(path: Path) -> OutputError:
    """Return the error for a path that holds a file of the user."""
    return OutputError(
        f"cannot write {path}: a file that PhySIC did not write, or a link, is there; move it "
        "away, or name another folder"
    )


def open_to_append(path: Path) -> BinaryIO:
    """Open a file for reading and appending; it is created if missing.

    Raises:
        OSError: it is a link, or cannot be opened.
    """

    def opener(name: str, flags: int) -> int:
        return os.open(name, flags | getattr(os, "O_NOFOLLOW", 0), 0o666)

    if path.is_symlink():  # where O_NOFOLLOW is missing
        raise OSError(None, "it is a link; move it away", str(path))
    return open(path, "ab+", opener=opener)


def has_mark(path: str | os.PathLike[str], mark: str = MARK) -> bool:
    """Return whether the start of a file has the mark.

    Raises:
        OSError: it cannot be read, or is not a regular file.
    """
    with open_regular(Path(path)) as file:
        return mark.encode() in file.read(_START_BYTES)


_UNREADABLE = {
    errno.ENOENT: "there is no such file; check the path",
    errno.ENOTDIR: "there is no such file; check the path",
    errno.ELOOP: "it is a link to itself; name the file",
    errno.EISDIR: "it is a folder; name a file",
    errno.EINVAL: "it is not a regular file, but a pipe or a device; save its content as a file, "
    "and name that",
}


def unreadable(error: OSError) -> str:
    """Return why a file cannot be read and what to do, as the end of a sentence."""
    return _UNREADABLE.get(error.errno or 0, f"{error.strerror or error}; check who may read it")


def check_regular(path: Path) -> None:
    """Check that a path is that of a regular file, or of a link to one, without opening it.

    Raises:
        OSError: the file is missing, a folder, a pipe or a device, or cannot be found.
    """
    try:
        mode = path.stat().st_mode
    except ValueError as error:  # characters that no path has
        raise FileNotFoundError(errno.ENOENT, str(error), str(path)) from error
    if not stat.S_ISREG(mode):
        number = errno.EISDIR if stat.S_ISDIR(mode) else errno.EINVAL
        raise OSError(number, "not a regular file", str(path))


def open_regular(path: Path) -> BufferedReader:
    """Open a regular file, or a link to one, for reading.

    Raises:
        OSError: the file is missing, is not a regular file, or cannot be read; :func:`unreadable`
            says why.
    """
    check_regular(path)
    return path.open("rb")


def read_regular(path: Path, limit: int) -> bytes:
    """Read a regular file, or a link to one.

    Args:
        path: of the file.
        limit: largest size, bytes.

    Raises:
        OSError: the file is missing, is not a regular file, is larger than the limit, or cannot be
            read.
    """
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        if size > limit:
            raise OSError(errno.EFBIG, f"it has {size:,} bytes, more than {limit:,}", str(path))
        return file.read(size)


def read_text(path: Path, limit: int) -> str:
    """Read a regular file of text, or a link to one: see :func:`read_regular`.

    Raises:
        OSError: as there.
        ValueError: the text is not in UTF-8.
    """
    try:
        return read_regular(path, limit).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError("it is not text in UTF-8: name a text file, and save it so") from error
