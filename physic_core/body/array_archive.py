"""Arrays of an ``.npz``, whose shapes and types are known before memory is taken for them."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Header", "archived_header", "archived_numbers"]


@dataclass(frozen=True)
class Header:
    """What a member of an archive says of its array.

    Attributes:
        shape: of its axes.
        dtype: of its numbers.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]


def archived_header(archive: zipfile.ZipFile, name: str) -> Header:
    """Of one array, without its numbers.

    Raises:
        Exception: one of the many of zipfile, its compressors and numpy, where the member is damaged.
    """
    with archive.open(f"{name}.npy") as stream:
        version = np.lib.format.read_magic(stream)
        read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}[version]
        shape, _, dtype = read(stream)
    if min(shape, default=0) < 0:
        raise ValueError(f"the shape {shape}")
    return Header(tuple(shape), dtype)


def archived_numbers(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    """The array; nothing is unpickled.

    Raises:
        Exception: as of :func:`archived_header`.
    """
    with archive.open(f"{name}.npy") as stream:
        found: NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
    return found
