"""Digest of the source code of a class, so that the output of older code is not reused.

A version number identifies the code of an installed release, but not that of a plugin under development.
"""

from __future__ import annotations

import hashlib
import os
import sys
import time
from pathlib import Path

__all__ = ["CodeDigester"]

_STARTED = time.time()
"""About when this process read the code that it runs."""

_BYTES = 16
_MANY = 2000
"""A package of more files than this is named by the module of the class alone: to look at all would take too long."""


class CodeDigester:
    """Computes digests of classes; the files of each package are read only once."""

    def __init__(self) -> None:
        self._modules: dict[Path, bytes | None] = {}

    def digest(self, kind: type) -> str | None:
        """Digest of the packages that define a class and its bases.

        Sources count with their content, other files (weights, tables) with size and modification time. For a module
        outside any package, the modules in the same folder count.

        Returns:
            The digest. None if there is no reliable one: the class is defined in a function or an interactive session,
                or its files were modified after this process started.
        """
        whole = hashlib.blake2b(digest_size=_BYTES)
        for base in kind.__mro__:
            top = base.__module__.partition(".")[0]
            if top in sys.stdlib_module_names:
                continue
            file = getattr(sys.modules.get(base.__module__), "__file__", None)
            if file is None or top == "__main__" or "<locals>" in base.__qualname__:
                return None
            told = self._module(Path(file))
            if told is None:
                return None
            whole.update(told)
        return whole.hexdigest()

    def _module(self, module: Path) -> bytes | None:
        if module not in self._modules:
            self._modules[module] = _digest(_files(module))
        return self._modules[module]


def _files(module: Path) -> list[Path]:
    """The files of the top-level package that contains a module."""
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


def _digest(files: list[Path]) -> bytes | None:
    """Digest of files; None if one was modified while it was read."""
    whole = hashlib.blake2b(digest_size=_BYTES)
    try:
        for path in files:
            status = path.stat()
            whole.update(f"{path.name} {status.st_size};".encode())
            if path.suffix != ".py":
                whole.update(f"{status.st_mtime_ns};".encode())
            elif _STARTED < status.st_mtime <= time.time():
                return None
            else:
                whole.update(path.read_bytes())
    except OSError:
        return None
    return whole.digest()
