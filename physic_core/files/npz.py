"""Arrays out of an npz file, each checked against its checksum; no pickles."""

from __future__ import annotations

import io
import math
import zipfile
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.lib import format as npy

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

__all__ = ["MOST_BYTES", "read_arrays"]

MOST_BYTES = 1 << 32
"""What all arrays of a file may take in memory; a small file may claim any size."""

_SUFFIX = ".npy"
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def read_arrays(stream: IO[bytes], names: Iterable[str] | None = None) -> dict[str, NDArray[Any]]:
    """The arrays of a file, or those of ``names``.

    numpy's own reader stops where the header of an array says that it ends: of an array that a damaged header makes
    smaller it never reads the end, and so never compares the checksum. Here every member is read to its end.

    Raises:
        ValueError, zipfile.BadZipFile, and whatever else zipfile raises: the file is damaged, or no npz file.
        KeyError: a name is not there.
    """
    with zipfile.ZipFile(stream) as archive:
        if names is None:
            names = [entry.filename.removesuffix(_SUFFIX) for entry in archive.infolist()]
        entries = {name: archive.getinfo(name + _SUFFIX) for name in names}
        size = sum(entry.file_size for entry in entries.values())
        if size > MOST_BYTES:
            raise ValueError(f"its arrays claim {size / 1e9:.1f} GB")
        return {name: _array(archive.read(entry)) for name, entry in entries.items()}


def _array(content: bytes) -> NDArray[Any]:
    stream = io.BytesIO(content)
    version = npy.read_magic(stream)
    if version not in _HEADERS:
        raise ValueError(f"an array is in version {version} of numpy's format")
    shape, is_fortran, dtype = _HEADERS[version](stream)
    if dtype.hasobject:
        raise ValueError("an array holds Python objects")
    size = math.prod(shape) * dtype.itemsize
    if size != len(content) - stream.tell():
        raise ValueError(f"an array of {len(content) - stream.tell()} bytes should have {size}")
    if not size:
        return np.zeros(shape, dtype)
    flat = np.frombuffer(content, dtype, offset=stream.tell()).copy()
    return flat.reshape(shape, order="F" if is_fortran else "C")
