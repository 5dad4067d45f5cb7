"""The lock file ``physic.lock``: SHA-256 and revision of what its publisher did not pin, as first
fetched.

It is the file in the environment variable ``PHYSIC_LOCK``, else ``physic.lock`` in the current
folder if there is one, else in the folder of downloads. With a copy of it, another machine fetches
the same revisions, and both compare what they use with it.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_core.cache.digests import remembered_sha256
from physic_core.cache.folders import cache_folder
from physic_core.errors import WeightsMissingError

if TYPE_CHECKING:
    from physic_core.weights.manifest import WeightFile, WeightSet

LOCK_VARIABLE = "PHYSIC_LOCK"
"""Environment variable with the path of the lock file."""

FileUse = Mapping[str, str]
"""SHA-256 of a weight file in use, and its state: "published" if the manifest has it, "locked" if
the lock file has it, "unpinned" if neither has any, "differs" if the lock file has another.
"""

_NAME = "physic.lock"
_uses: ContextVar[dict[str, FileUse] | None] = ContextVar("uses", default=None)


def lock_file_path() -> Path | None:
    """Return the path of the lock file, which need not exist; None if there is no folder for it."""
    if named := os.environ.get(LOCK_VARIABLE):
        return Path(named).expanduser()
    if Path(_NAME).is_file():
        return Path(_NAME)
    folder = cache_folder("weights")
    return folder / _NAME if folder is not None else None


def read_lock() -> Mapping[str, Mapping[str, str]]:
    """Return the entries: by "set/file" with "sha256" and perhaps "revision", by URL of a
    repository with "commit".

    Raises:
        WeightsMissingError: the file is invalid.
    """
    path = lock_file_path()
    if path is None or not path.is_file():
        return {}
    try:
        found: dict[str, Any] = tomllib.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise WeightsMissingError(
            f"the lock file {path} cannot be read: {error}; mend or delete it"
        ) from error
    return {name: entry for name, entry in found.items() if isinstance(entry, dict)}


def locked(weights: WeightSet) -> WeightSet:
    """Return a weight set with the hashes and revisions of the lock file where its manifest has
    none.
    """
    entries = read_lock()
    files = tuple(
        _locked(file, entries.get(f"{weights.name}/{file.path}", {})) for file in weights.files
    )
    return replace(weights, files=files)


@contextmanager
def recorded_uses() -> Iterator[dict[str, FileUse]]:
    """Yield a dictionary that :func:`record_use` fills inside the ``with`` block."""
    uses: dict[str, FileUse] = {}
    token = _uses.set(uses)
    try:
        yield uses
    finally:
        _uses.reset(token)


def record_use(name: str, path: Path, published: str | None) -> None:
    """Record the SHA-256 of a weight file "set/file" that is used, and compare it with the lock
    file.
    """
    uses = _uses.get()
    if uses is None:
        return
    if published is not None:
        uses[name] = {"sha256": published, "state": "published"}
        return
    found = remembered_sha256(path)
    expected = read_lock().get(name, {}).get("sha256")
    state = "locked" if expected == found else "differs"
    if expected is None:
        state = "unpinned"
    uses[name] = {"sha256": found, "state": state}


def _locked(file: WeightFile, entry: Mapping[str, str]) -> WeightFile:
    from physic_core.weights.manifest import HubSource

    if file.is_pinned or not entry:
        return file
    origin = file.origin
    revision = entry.get("revision")
    moving = isinstance(origin, HubSource) and origin.revision == "main" and "@" not in file.source
    source = f"{file.source}@{revision}" if moving and revision else file.source
    return replace(file, sha256=entry.get("sha256"), source=source)
