"""Digest of the source code of a class, so that results of older code are not reused.

A version number identifies the code of an installed release, but not that of a plugin under development.
"""

from __future__ import annotations

import hashlib
import os
import sys
import time
from pathlib import Path

_STARTED = time.time()
"""Start time of this process; files modified later may differ from the imported code."""

_BYTES = 16
_MAX_FILES = 2000
"""Maximum number of files of a package; of a larger one only the module of the class is hashed."""


class CodeDigester:
    """Computes digests of the source code of classes; the files of each package are read only once."""

    def __init__(self) -> None:
        self._files: dict[Path, list[Path]] = {}
        self._digests: dict[Path, bytes | None] = {}

    def digest(self, kind: type) -> str | None:
        """Compute the digest of the packages that define a class and its bases.

        Sources count with their content, other files (weights, tables) with size and modification time. For a module
        outside any package, the modules in the same folder count.

        Returns:
            The digest. None if there is no reliable one: the class is defined in a function or an interactive session,
                or its files were modified after this process started.
        """
        digest = hashlib.blake2b(digest_size=_BYTES)
        for base in kind.__mro__:
            top = base.__module__.partition(".")[0]
            if top in sys.stdlib_module_names:
                continue
            file = getattr(sys.modules.get(base.__module__), "__file__", None)
            if file is None or top == "__main__" or "<locals>" in base.__qualname__:
                return None
            module_digest = self._module(Path(file))
            if module_digest is None:
                return None
            digest.update(module_digest)
        return digest.hexdigest()

    def _module(self, module: Path) -> bytes | None:
        package = _package(module)
        if package not in self._files:
            self._files[package] = _files(package)
        files = self._files[package]
        place = package if files else module
        if place not in self._digests:
            self._digests[place] = _digest(files or [module])
        return self._digests[place]


def _package(module: Path) -> Path:
    """Return the folder of the top-level package that contains a module; that of the module outside any package."""
    root = module.parent
    while (root / "__init__.py").is_file() and (root.parent / "__init__.py").is_file():
        root = root.parent
    return root


def _files(root: Path) -> list[Path]:
    """Return the files of a package, none if it is too large; the modules of a folder that is not a package."""
    if not (root / "__init__.py").is_file():
        return sorted(root.glob("*.py"))
    files: list[Path] = []
    for folder, folders, names in os.walk(root):
        folders[:] = sorted(name for name in folders if name != "__pycache__")
        files += [Path(folder, name) for name in sorted(names)]
        if len(files) > _MAX_FILES:
            return []
    return files


def _digest(files: list[Path]) -> bytes | None:
    """Compute the digest of files; None if one was modified after this process started."""
    digest = hashlib.blake2b(digest_size=_BYTES)
    try:
        for path in files:
            status = path.stat()
            digest.update(f"{path.name} {status.st_size};".encode())
            if path.suffix != ".py":
                digest.update(f"{status.st_mtime_ns};".encode())
            elif _STARTED < status.st_mtime <= time.time():
                return None
            else:
                digest.update(path.read_bytes())
    except OSError:
        return None
    return digest.digest()
