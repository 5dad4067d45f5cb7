"""Find results in folders, and notice when they change."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from physic_core.errors import InputError

_FILES = ("reconstruction.json", "reconstruction.npz")


@dataclass(frozen=True)
class FoundResult:
    """The folder of a result, and what its files were when it was found.

    Attributes:
        name: of the folder, relative to the source.
        folder: of the result.
        stamp: modification time, ns, and size of each file; two equal stamps are the same result.
    """

    name: str
    folder: Path
    stamp: tuple[tuple[int, int], ...]

    @property
    def written(self) -> int:
        """Time of the last change, ns."""
        return max((time for time, _ in self.stamp), default=0)


class ResultSource:
    """A folder that a user named: of one result, or of any number of them.

    Raises:
        InputError: there is no such folder.
    """

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            raise InputError(f"no folder {folder}: name the folder of a finished run, or a folder of such folders")
        self.folder = folder

    @property
    def title(self) -> str:
        """Name of the folder."""
        return self.folder.resolve().name

    def find(self) -> list[FoundResult]:
        """Return all results in the folder, sorted by name; an incomplete result counts, an empty folder does not."""
        found = []
        for at, folders, names in os.walk(self.folder):
            folders.sort()
            if set(_FILES) & set(names):
                folder = Path(at)
                name = folder.relative_to(self.folder).as_posix()
                found.append(FoundResult(self.title if name == "." else name, folder, _stamp(folder)))
                if name == ".":
                    break
        return sorted(found, key=lambda result: result.name)


def _stamp(folder: Path) -> tuple[tuple[int, int], ...]:
    stamp = []
    for name in _FILES:
        try:
            status = os.stat(folder / name)
        except OSError:
            stamp.append((0, -1))
        else:
            stamp.append((status.st_mtime_ns, status.st_size))
    return tuple(stamp)
