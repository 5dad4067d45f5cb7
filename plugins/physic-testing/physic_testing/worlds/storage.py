"""Keeps built worlds and settled performances on disk, so that each is built once per machine.

Files lie in ``$XDG_CACHE_HOME/physic/worlds``, or in the system's own place for caches. Set ``PHYSIC_WORLD_CACHE`` to
another folder, or to "off". A file that cannot be read is built anew; a disk that cannot be written costs time only.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TypeVar

from physic_core import body
from physic_core.cache.folders import cache_folder
from physic_core.cache.lru_folder import mark_used, trim_folder
from physic_core.errors import OutputError
from physic_core.files.archive import DamagedFileError, pack, read_archive, unpack, write_archive

__all__ = ["BYTES", "SWITCH", "VERSION", "folder", "kept", "key_of"]

T = TypeVar("T")

VERSION = 1
"""To be raised when the same name, seed and size mean another world for a reason outside ``physic_testing``."""

SWITCH = "PHYSIC_WORLD_CACHE"
"""Environment variable: a folder, or "off"."""

BYTES = 3 << 30
"""What all files together may take; those unused for longest go first."""

_SUFFIX = ".npz"


def folder() -> Path | None:
    """Where worlds are kept, or None if they are not."""
    return cache_folder("worlds", SWITCH)


def key_of(*parts: str | int, without: tuple[str, ...] = ()) -> str:
    """A file name for what these parts name, with a digest of what builds it.

    Args:
        parts: name it.
        without: modules of ``physic_testing`` that it does not depend on.
    """
    return "-".join(str(part) for part in (*parts, _builder(without)))


def kept(key: str, kind: type[T], classes: Iterable[type], build: Callable[[], T]) -> T:
    """What is kept under a key, or else what ``build`` answers, which is then kept.

    Args:
        key: of ``key_of``.
        kind: the dataclass that is kept.
        classes: other dataclasses in it.
        build: builds it.
    """
    where = folder()
    if where is None:
        return build()
    found = _load(where / (key + _SUFFIX), kind, (kind, *classes))
    if found is None:
        found = build()
        # A disk that cannot be written costs time, no more.
        with suppress(OSError, OutputError):
            _save(where, key + _SUFFIX, found)
    return found


def _load(path: Path, kind: type[T], classes: Iterable[type]) -> T | None:
    try:
        thing = unpack(*read_archive(path), classes)
    except (OSError, DamagedFileError, KeyError, TypeError):
        return None  # not there, or not whole: built anew
    mark_used(path)
    return thing if isinstance(thing, kind) else None


def _save(where: Path, name: str, thing: object) -> None:
    write_archive(where / name, *pack(thing))
    trim_folder(where, BYTES, _SUFFIX)


@cache
def _builder(without: tuple[str, ...]) -> str:
    """A digest of this version, the sources of the worlds, and the body."""
    digest = hashlib.sha256(f"{VERSION}".encode())
    here = Path(__file__).parent
    sources = [path for path in sorted(here.glob("*.py")) if path.stem not in without]
    for path in (*sources, Path(body.__file__).with_name("embedded.sha256")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]
