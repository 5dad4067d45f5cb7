"""Names of files that others may have written: in a document, a journal or the listing of a
folder.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from physic_core.errors import InputError


@dataclass(frozen=True)
class UntrustedName:
    """Name of a file or folder, which may begin with folders; it is no path, and gives one only by
    :meth:`inside`.

    Attributes:
        text: the name, with "/" after each folder.
    """

    text: str

    def inside(self, folder: str | os.PathLike[str]) -> Path:
        """Return the path of the name in a folder, there or not.

        Raises:
            InputError: it leads out of the folder when all links are followed, or no path can have
                it.
        """
        root = Path(os.path.realpath(folder))
        with suppress(ValueError):  # characters that no path has
            if root in Path(os.path.realpath(root / self.text)).parents:
                return Path(folder, self.text)
        raise InputError(
            f"cannot use {Path(folder, self.text)!s:.300}: it, or a link on the way, leads out of "
            f"{folder}; put the file itself there"
        )


def paths_inside(folder: str | os.PathLike[str], names: Iterable[str]) -> dict[str, Path]:
    """Return the names that lead into a folder, in their order, with their paths: see
    :class:`UntrustedName`.
    """
    paths = {}
    for name in names:
        with suppress(InputError):
            paths[name] = UntrustedName(name).inside(folder)
    return paths
