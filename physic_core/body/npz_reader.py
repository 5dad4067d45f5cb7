"""Read arrays of an ``.npz`` file; headers can be read and checked before the data are loaded."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["ArrayHeader", "is_archive", "read_array", "read_header"]


@dataclass(frozen=True)
class ArrayHeader:
    """Shape and type of an array in an ``.npz`` file."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]


def is_archive(path: Path) -> bool:
    """Return whether a file is a zip archive; also for a damaged one that is recognised by its end."""
    try:
        return zipfile.is_zipfile(path)
    except zipfile.BadZipFile:  # of an end that states several disks
        return True


def read_header(archive: zipfile.ZipFile, name: str) -> ArrayHeader:
    """Read the shape and type of one array, without its data.

    Raises:
        Exception: any error of zipfile, its compressors or numpy, if the file is damaged.
    """
    with archive.open(f"{name}.npy") as stream:
        version = np.lib.format.read_magic(stream)
        read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}[version]
        shape, _, dtype = read(stream)
    if min(shape, default=0) < 0:
        raise ValueError(f"the shape {shape}")
    return ArrayHeader(tuple(shape), dtype)


def read_array(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    """Read one array; pickled objects are refused.

    Raises:
        Exception: any error of zipfile, its compressors or numpy, if the file is damaged.
    """
    with archive.open(f"{name}.npy") as stream:
        found: NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
    return found
