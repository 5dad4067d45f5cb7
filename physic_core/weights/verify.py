"""Compare weight files with the size and the SHA-256 in a manifest, and require that those in use agree."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING

from physic_core.errors import BackendError

if TYPE_CHECKING:
    from io import BufferedReader

    from physic_core.weights.manifest import WeightFile


def describe_mismatch(path: Path, file: WeightFile) -> str:
    """Describe how the size or SHA-256 of a file differs from its manifest; "" if they match."""
    size = path.stat().st_size
    if file.bytes is not None and size != file.bytes:
        return f"it has {size} bytes instead of {file.bytes}"
    if file.sha256 is not None and (found := sha256_of(path)) != file.sha256:
        return f"its SHA-256 is {found} instead of {file.sha256}"
    return ""


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits."""
    with path.open("rb") as file:
        return sha256_of_open(file)


def sha256_of_open(file: BufferedReader) -> str:
    """Return the SHA-256 of an open file, from its place on, as hexadecimal digits."""
    return hashlib.file_digest(file, "sha256").hexdigest()


_Stamp = tuple[int, int, int, int, int]
"""Device, inode, size, and times of the last change of content and of inode. No user can set the last one."""

_compared: dict[tuple[Path, str], _Stamp] = {}
"""Files with the SHA-256 beside them. They are read once in a process: a record on disk would hide later damage."""

_used: ContextVar[dict[Path, _Stamp] | None] = ContextVar("used", default=None)


def require_published_sha256(path: Path, file: WeightFile, advice: str) -> None:
    """Raise BackendError unless a file has the SHA-256 of its manifest; without one, there is nothing to compare.

    Args:
        path: of the file; links are followed.
        file: its entry in the manifest.
        advice: for the message.

    Raises:
        BackendError: the file differs, cannot be read, or was written meanwhile.
    """
    if file.sha256 is None:
        return
    try:
        with path.open("rb") as opened:
            stamp = _stamp(os.fstat(opened.fileno()))
            if _compared.get((path, file.sha256)) != stamp:
                if file.bytes is not None and stamp[2] != file.bytes:
                    raise BackendError(
                        f"{path} is not the published file: it has {stamp[2]} bytes instead of {file.bytes}: {advice}"
                    )
                found = sha256_of_open(opened)
                if found != file.sha256:
                    raise BackendError(
                        f"{path} is not the published file: its SHA-256 is {found} instead of {file.sha256}: {advice}"
                    )
                if _stamp(os.fstat(opened.fileno())) != stamp:
                    raise BackendError(f"{path} was written while it was read: try again when it is complete")
                _compared[path, file.sha256] = stamp
    except OSError as error:
        raise BackendError(f"{path} cannot be read ({error.strerror}): {advice}") from error
    used = _used.get()
    if used is not None:
        used[path] = stamp


@contextmanager
def require_unchanged_files() -> Iterator[None]:
    """Raise BackendError at the end if a file of :func:`require_published_sha256` was replaced after it was compared.

    Raises:
        BackendError: such a file is another one now.
    """
    used: dict[Path, _Stamp] = {}
    token = _used.set(used)
    try:
        yield
    finally:
        _used.reset(token)
    for path, stamp in used.items():
        try:
            same = _stamp(path.stat()) == stamp
        except OSError:
            same = False
        if not same:
            raise BackendError(f"{path} was replaced while it was loaded: try again when it is complete")


def _stamp(status: os.stat_result) -> _Stamp:
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns
