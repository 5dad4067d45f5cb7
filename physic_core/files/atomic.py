"""Atomic writes of files, and a check that a folder can be written."""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from physic_core.errors import OutputError

__all__ = ["atomic_write", "check_writable"]


@contextmanager
def atomic_write(folder: Path) -> Iterator[Callable[[str], Path]]:
    """Yield a function from a file name to a temporary path; on success, rename all temporary files.

    Raises:
        OutputError: the folder cannot be written, the disk is full, or a folder has the name of a file.
    """
    paths: dict[str, Path] = {}
    token = secrets.token_hex(4)

    def temporary(name: str) -> Path:
        # In the same folder, since a rename is atomic only within one file system.
        return paths.setdefault(name, folder / f".{name}.{token}.part")

    try:
        yield temporary
        for name in paths:
            if os.path.isdir(folder / name) and not os.path.islink(folder / name):
                raise OutputError(f"cannot write {folder / name}: a folder has this name; remove it, or move it away")
        for name, path in paths.items():
            os.replace(path, folder / name)
    except OSError as error:
        raise _refusal(folder, error) from error
    finally:
        for path in paths.values():
            with suppress(OSError):
                path.unlink(missing_ok=True)


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
        probe = folder / f".{secrets.token_hex(4)}.part"
        try:
            probe.write_bytes(b"")
        finally:
            probe.unlink(missing_ok=True)
    except OSError as error:
        raise _refusal(folder, error) from error
    return folder


def _refusal(folder: Path, error: OSError) -> OutputError:
    if os.path.isfile(folder):  # Path's own raises where the way there is closed
        return OutputError(f"cannot write results to {folder}: it is a file; name a folder, or move the file away")
    return OutputError(
        f"cannot write results to {folder}: {error.strerror or error}; name another folder, or mend this"
    )
