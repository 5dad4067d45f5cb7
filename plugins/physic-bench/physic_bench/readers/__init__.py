"""Readers of results, by name."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from physic_core.errors import InputError

if TYPE_CHECKING:
    from physic_bench.bodies import BodyFiles
    from physic_bench.readers.base import ResultReader

__all__ = ["READERS", "open_reader", "reader_class"]

READERS = ("physic", "plain", "physic-release", "physic-release-init")
"""Names; each is a module of this package, with "_" for "-"."""


def reader_class(name: str) -> type[ResultReader]:
    """Return the class of a reader.

    Raises:
        InputError: there is none of this name.
    """
    if name not in READERS:
        raise InputError(f"no reader is named '{name}': choose one of {', '.join(READERS)}")
    found: type[ResultReader] = import_module(f"{__name__}.{name.replace('-', '_')}").READER
    return found


def open_reader(name: str, folder: Path, bodies: BodyFiles) -> ResultReader:
    """Return a reader of a folder.

    Raises:
        InputError: there is no such reader or folder.
    """
    if not folder.is_dir():
        raise InputError(f"there is no folder {folder} with results of '{name}'")
    return reader_class(name)(folder, bodies)
