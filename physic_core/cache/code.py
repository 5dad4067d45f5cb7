"""Which code a class is: so that an answer of yesterday's code is not taken for one of today's.

An installed version names its code; a plugin that is being written keeps its version while its code changes.
"""

from __future__ import annotations

import hashlib
import os
import sys
import time
from pathlib import Path

__all__ = ["code_of"]

_STARTED = time.time()
"""About when this process read the code that it runs."""

_MANY = 2000
"""A package of more files than this is named by the module of the class alone: to look at all would take too long."""


def code_of(kind: type) -> str | None:
    """Digest of the packages in which a class and its bases are written.

    Sources count with their contents, other files (weights, tables) with size and time. For a module that lies in no
    package, the modules beside it count.

    Returns:
        None where no digest can name it: it is made in a function, typed into a session, or its files were edited
        after this process began, so that what runs may not be what they say.
    """
    whole = hashlib.blake2b(digest_size=16)
    seen = set()
    for base in kind.__mro__:
        top = base.__module__.partition(".")[0]
        if top in sys.stdlib_module_names:
            if top == "__main__":
                return None
            continue
        file = getattr(sys.modules.get(base.__module__), "__file__", None)
        if file is None or "<locals>" in base.__qualname__:
            return None
        for path in _files_of(Path(file)):
            if path not in seen:
                seen.add(path)
                told = _told(path)
                if told is None:
                    return None
                whole.update(told)
    return whole.hexdigest()


def _files_of(module: Path) -> list[Path]:
    """The files of the topmost package that holds a module."""
    root = module.parent
    if not (root / "__init__.py").is_file():
        return sorted(root.glob("*.py"))
    while (root.parent / "__init__.py").is_file():
        root = root.parent
    files: list[Path] = []
    for folder, folders, names in os.walk(root):
        folders[:] = sorted(name for name in folders if name != "__pycache__")
        files += [Path(folder, name) for name in sorted(names)]
        if len(files) > _MANY:
            return [module]
    return files


def _told(path: Path) -> bytes | None:
    """What counts of one file, or None if it was edited under way."""
    try:
        status = path.stat()
        if path.suffix != ".py":
            return f"{path} {status.st_size} {status.st_mtime_ns};".encode()
        if _STARTED < status.st_mtime <= time.time():
            return None
        return f"{path.name} {status.st_size};".encode() + path.read_bytes()
    except OSError:
        return None
