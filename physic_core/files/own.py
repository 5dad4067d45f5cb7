"""Which files PhySIC may replace: those that carry its mark. Files of its own are never opened through a link."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

from physic_core.errors import OutputError
from physic_core.files.atomic import atomic_write, check_writable

MARK = "Written by PhySIC. The same command replaces this file."
"""Text in a file by which PhySIC knows later that it may replace the file."""

_END_BYTES = 1 << 16  # a page has the mark at its start, and a Parquet table at its end


def check_own(*paths: Path, mark: str = MARK) -> None:
    """Check that no file of the user would be replaced; call it before anything is computed.

    Args:
        paths: of the files that will be written.
        mark: text that the first or last 64 kB of these files contain, in UTF-8.

    Raises:
        OutputError: one of them exists, and is not a regular file with the mark; a link counts as a file of the user.
    """
    for path in paths:
        try:
            is_own = stat.S_ISREG(os.lstat(path).st_mode) and mark.encode() in _both_ends(path)
        except FileNotFoundError:
            continue
        except OSError as error:
            raise OutputError(f"cannot write {path}: {error.strerror}; name another folder") from error
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
    """Return the error that says that a path is of the user."""
    return OutputError(
        f"cannot write {path}: a file that PhySIC did not write, or a link, is there; move it away, or name another "
        "folder"
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


def _both_ends(path: Path) -> bytes:
    with path.open("rb") as file:
        start = file.read(_END_BYTES)
        file.seek(max(file.tell(), file.seek(0, os.SEEK_END) - _END_BYTES))
        return start + file.read()
