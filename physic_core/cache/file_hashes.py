"""SHA-256 of the user's files; large files are read once, also by several processes, until they change."""

from __future__ import annotations

import hashlib
import os
import re
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from physic_core.cache.folders import claimed_cache
from physic_core.errors import OutputError
from physic_core.files.atomic import atomic_write

_MAX_BYTES = 1 << 16
"""All kept hashes have at most this size, which is 1000 files."""
_CLOCK_NS = 2_000_000_000
"""A file can change twice within one step of its clock, which is up to 2 s (FAT)."""

_known: dict[str, str] = {}


def remembered_sha256(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits, from the cache if the file has not changed.

    A changed file has another size, inode, or time of the last change of content or inode. No user can set the last.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        status = os.fstat(file.fileno())
        stamp = f"{status.st_dev} {status.st_ino} {status.st_size} {status.st_mtime_ns} {status.st_ctime_ns}"
        name = hashlib.sha256(f"{path.resolve()} {stamp}".encode()).hexdigest()[:32]
        found = _known.get(name) or _read(name)
        if found is None:
            found = hashlib.file_digest(file, "sha256").hexdigest()
            if status.st_ctime_ns < time.time_ns() - _CLOCK_NS:
                _known[name] = found
                _write(name, found)
    return found


def files_named_by(settings: Any) -> Iterator[tuple[str, str]]:
    """Yield path and SHA-256 of every file that a text in settings names.

    Args:
        settings: a text, or mappings, lists and tuples of settings.
    """
    if isinstance(settings, Mapping):
        settings = list(settings.values())
    if isinstance(settings, tuple | list):
        for value in settings:
            yield from files_named_by(value)
    elif isinstance(settings, str):
        with suppress(OSError, ValueError):  # a text that cannot be a path
            path = Path(os.path.expanduser(settings))
            if path.is_file():
                yield str(path.absolute()), remembered_sha256(path)


def _read(name: str) -> str | None:
    kept = claimed_cache("hashes")
    if kept is None:
        return None
    try:
        text = (kept.path / f"{name}{kept.suffix}").read_text("ascii")
    except (OSError, ValueError):
        return None
    kept.mark_used(f"{name}{kept.suffix}")
    return text if re.fullmatch("[0-9a-f]{64}", text) else None


def _write(name: str, sha256: str) -> None:
    kept = claimed_cache("hashes")
    with suppress(OSError, OutputError):  # it can be computed again
        if kept is not None:
            with atomic_write(kept.path) as temporary:
                part = temporary(f"{name}{kept.suffix}")
                part.touch(mode=0o600)
                part.write_text(sha256, "ascii")
            kept.trim(_MAX_BYTES)
