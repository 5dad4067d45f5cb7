"""Compare weight files with the size and the SHA-256 in a manifest."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import TYPE_CHECKING

from physic_core.errors import BackendError

if TYPE_CHECKING:
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
        return hashlib.file_digest(file, "sha256").hexdigest()


_Stamp = tuple[int, int, int, int, int]
"""Device, inode, size, and times of the last change of content and of inode. No user can set the last one."""

_compared: dict[tuple[Path, str], _Stamp] = {}
"""Files with the SHA-256 beside them. They are read once in a process: a record on disk would hide later damage."""


def require_published_sha256(path: Path, file: WeightFile, advice: str) -> None:
    """Raise BackendError unless a file has the SHA-256 of its manifest; without one, there is nothing to compare.

    Args:
        path: of the file; links are followed.
        file: its entry in the manifest.
        advice: for the message.

    Raises:
        BackendError: the file differs or cannot be read.
    """
    if file.sha256 is None:
        return
    try:
        stamp = _stamp(path.stat())
        if _compared.get((path, file.sha256)) != stamp:
            if wrong := describe_mismatch(path, file):
                raise BackendError(f"{path} is not the published file: {wrong}: {advice}")
            _compared[path, file.sha256] = stamp
    except OSError as error:
        raise BackendError(f"{path} cannot be read ({error.strerror}): {advice}") from error


def _stamp(status: os.stat_result) -> _Stamp:
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns
