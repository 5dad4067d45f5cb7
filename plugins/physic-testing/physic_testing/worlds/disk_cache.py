"""Disk cache of worlds and of the cameras of their views.

The folder is ``$XDG_CACHE_HOME/physic/worlds``, or the system's default for caches. Set
``PHYSIC_WORLD_CACHE`` to another folder, or to "off". A damaged file is rebuilt. If the folder is
not writable, worlds are built in every process.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TypeVar

from physic_core import body
from physic_core.cache.folders import LruFolder, cache_folder
from physic_core.errors import OutputError
from physic_core.files.plain import DamagedFileError, read_value, write_value

__all__ = ["FOLDER_VARIABLE", "MAX_BYTES", "VERSION", "cache_key", "folder", "load_or_build"]

T = TypeVar("T")

VERSION = 1
"""Version of the cached files; increase it if worlds change for a reason outside
``physic_testing``.
"""

FOLDER_VARIABLE = "PHYSIC_WORLD_CACHE"
"""Name of the environment variable for the cache folder; "off" disables the cache."""

MAX_BYTES = 3 << 30
"""Maximum total size of the files; the least recently used files are deleted first."""

_SUFFIX = ".npz"


def folder() -> Path | None:
    """Return the cache folder, or None if the cache is off."""
    return cache_folder("worlds", FOLDER_VARIABLE)


def cache_key(*parts: str | int) -> str:
    """Return a file name from identifying parts and a hash of the source code and data that build
    the entry.
    """
    return "-".join(str(part) for part in (*parts, _builder()))


def load_or_build(key: str, kind: type[T], classes: Iterable[type], build: Callable[[], T]) -> T:
    """Load a cache entry, or build and store it.

    Args:
        key: result of ``cache_key``.
        kind: dataclass of the entry.
        classes: other dataclasses in the entry.
        build: builds the entry.
    """
    where = folder()
    if where is None:
        return build()
    found = _load(where / (key + _SUFFIX), kind, (kind, *classes))
    if found is None:
        found = build()
        # Without a writable folder, worlds are rebuilt in every process.
        with suppress(OSError, OutputError):
            _save(where, key + _SUFFIX, found)
    return found


def _load(path: Path, kind: type[T], classes: Iterable[type]) -> T | None:
    """Read a cache entry; None if it is missing or damaged."""
    try:
        thing = read_value(path, classes)
    except (OSError, DamagedFileError):
        return None  # missing or damaged: the caller rebuilds it
    LruFolder(path.parent, _SUFFIX).mark_used(path.name)
    return thing if isinstance(thing, kind) else None


def _save(where: Path, name: str, thing: object) -> None:
    """Write a cache entry and delete old ones."""
    write_value(where / name, thing)
    LruFolder(where, _SUFFIX).trim(MAX_BYTES)


@cache
def _builder() -> str:
    """Return a hash of the cache version, the world modules with their data, and the embedded
    body.
    """
    digest = hashlib.sha256(f"{VERSION}".encode())
    here = Path(__file__).parent
    for path in (
        *sorted([*here.glob("*.py"), *here.glob("*.npz")]),
        Path(body.__file__).with_name("embedded.sha256"),
    ):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]
