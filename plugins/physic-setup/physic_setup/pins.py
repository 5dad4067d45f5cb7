"""Write the lock file ``physic.lock``: what was fetched first; :mod:`physic_core.weights.lock`
reads it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from physic_core.cache.digests import remembered_sha256
from physic_core.errors import OutputError
from physic_core.weights.lock import lock_file_path, read_lock
from physic_core.weights.manifest import WeightSet

_HEAD = (
    "# What was fetched first, by `physic weights fetch` and `physic setup --run`. Keep it "
    "with your project.\n"
)


def pin(entries: Mapping[str, Mapping[str, str]]) -> None:
    """Add entries to the lock file; those that it has stay as they are.

    Raises:
        OutputError: the file cannot be written.
    """
    held = read_lock()
    path = lock_file_path()
    if path is None or not entries.keys() - held.keys():
        return
    lines = [_HEAD]
    for name, entry in sorted({**entries, **held}.items()):
        lines += [
            f"[{json.dumps(name)}]",
            *(f"{key} = {json.dumps(value)}" for key, value in entry.items()),
            "",
        ]
    part = path.with_name(f"{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_text("\n".join(lines), encoding="utf-8")
        part.replace(path)
    except OSError as error:
        raise OutputError(f"the lock file {path} cannot be written: {error.strerror}") from error


def pin_files(weights: WeightSet, here: Mapping[str, Path]) -> None:
    """Add the files of a weight set that are here and that neither its manifest nor the lock file
    has pinned.
    """
    held = read_lock()
    found = {}
    for file in weights.files:
        name = f"{weights.name}/{file.path}"
        path = here.get(file.path)
        if path is not None and file.sha256 is None and name not in held:
            commit = _snapshot(path)
            found[name] = {"sha256": remembered_sha256(path)} | (
                {"revision": commit} if commit else {}
            )
    pin(found)


def _snapshot(path: Path) -> str:
    """Return the commit in the path of a file in the cache of Hugging Face; "" for another path."""
    parts = path.parts
    return parts[parts.index("snapshots") + 1] if "snapshots" in parts[:-2] else ""
