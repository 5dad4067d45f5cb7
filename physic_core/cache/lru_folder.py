"""Cache folder with a maximum size; the least recently used files are deleted first."""

from __future__ import annotations

import os
import shutil
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

_INCOMPLETE_AGE_S = 3600.0
"""Age after which an incomplete file is deleted, s."""


@dataclass(frozen=True)
class CacheFile:
    """Path, size in bytes, and time of the last use (s since the epoch) of a cache file."""

    path: Path
    size: int
    used: float

    def delete(self) -> bool:
        """Delete the file, and return whether that was possible."""
        try:
            if self.path.is_dir():  # an incomplete file with its parts
                shutil.rmtree(self.path)
            else:
                self.path.unlink()
        except OSError:
            return False
        return True


@dataclass(frozen=True)
class LruFolder:
    """The files of one cache in a folder.

    Attributes:
        path: of the folder, which need not exist.
        suffix: of the files; other files are never deleted.
    """

    path: Path
    suffix: str

    def files(self) -> list[CacheFile]:
        """Return the files, least recently used first."""
        return sorted(self._matching(f"[!.]*{self.suffix}"), key=lambda file: (file.used, file.path))

    def mark_used(self, name: str) -> None:
        """Set the last use of a file to now."""
        with suppress(OSError):
            os.utime(self.path / name)

    def trim(self, limit: int) -> None:
        """Delete old incomplete files, then the least recently used files beyond ``limit`` bytes."""
        for file in self._incomplete():
            if file.used < time.time() - _INCOMPLETE_AGE_S:
                file.delete()
        files = self.files()
        total = sum(file.size for file in files)
        for file in files:
            if total <= limit:
                break
            file.delete()
            total -= file.size

    def clear(self) -> list[CacheFile]:
        """Delete all files and return the deleted ones."""
        for file in self._incomplete():
            file.delete()
        return [file for file in self.files() if file.delete()]

    def _incomplete(self) -> list[CacheFile]:
        return self._matching(f".*{self.suffix}.*.physic-part")

    def _matching(self, pattern: str) -> list[CacheFile]:
        files = []
        with suppress(OSError):
            for path in self.path.glob(pattern):
                with suppress(OSError):  # another process may delete it
                    status = path.stat()
                    files.append(CacheFile(path, status.st_size, status.st_mtime))
        return files
