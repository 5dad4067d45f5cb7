"""Read and write npz files without pickle; sizes are bounded before anything is inflated, checksums
are verified.
"""

from __future__ import annotations

import math
import warnings
import zipfile
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.lib import format as npy

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from physic_core.types import AnyArray

MAX_ARRAY_BYTES = 1 << 32
"""Maximum size in memory of all arrays of one file, bytes; a damaged header can state any size."""

_SUFFIX = ".npy"
_FIXED_DATE = (1980, 1, 1, 0, 0, 0)  # equal arrays make equal files
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
_KINDS_OF_MEMBERS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


class ObjectArrayError(ValueError):
    """An array holds Python objects, which are pickled in the file and never opened."""


@dataclass(frozen=True)
class ArrayHeader:
    """Dtype and shape of an array in a file.

    Attributes:
        dtype: of the array.
        shape: of the array.
    """

    dtype: np.dtype[Any]
    shape: tuple[int, ...]


def read_names(stream: IO[bytes]) -> list[str]:
    """Read the names of all arrays of a file.

    Raises:
        ValueError, zipfile.BadZipFile, and other errors of zipfile: the file is damaged, or is not
            an npz file.
    """
    with zipfile.ZipFile(stream) as archive:
        return list(_entries(archive, None))


def read_headers(stream: IO[bytes], names: Iterable[str] | None = None) -> dict[str, ArrayHeader]:
    """Read dtype and shape of all arrays of a file, or only of those in ``names``; no array is
    inflated.

    The size of a member is that which its header states, so reading an array takes no more memory
    than its header says.

    Raises:
        ValueError, zipfile.BadZipFile, and other errors of zipfile: the file is damaged, or is not
            an npz file.
        KeyError: an array in ``names`` is missing.
    """
    with zipfile.ZipFile(stream) as archive:
        return {
            name: _array_header(archive, entry) for name, entry in _entries(archive, names).items()
        }


def read_arrays(
    stream: IO[bytes], names: Iterable[str] | None = None, *, limit: int | None = None
) -> dict[str, AnyArray]:
    """Read all arrays of a file, or only those in ``names``.

    Each array has the size of its member, so that its checksum is verified. ``numpy.load`` stops
    where a damaged header says that the array ends, and skips the checksum.

    Args:
        stream: of the file.
        names: of the arrays; None for all.
        limit: largest size in memory of these arrays, bytes; None for :data:`MAX_ARRAY_BYTES`.

    Raises:
        ValueError, zipfile.BadZipFile, and other errors of zipfile: the file is damaged, or is not
            an npz file.
        KeyError: an array in ``names`` is missing.
    """
    with zipfile.ZipFile(stream) as archive:
        entries = _entries(archive, names)
        size = sum(entry.file_size for entry in entries.values())
        limit = MAX_ARRAY_BYTES if limit is None else limit
        if size > limit:
            raise ValueError(
                f"its arrays need {size / 1e6:,.0f} MB; the limit is {limit / 1e6:,.0f} MB"
            )
        return {name: _array(archive, entry) for name, entry in entries.items()}


def write_arrays(
    path: Path | IO[bytes], arrays: Mapping[str, AnyArray], *, stored: str = ""
) -> None:
    """Write arrays to an npz file, with fast compression (zlib level 1).

    Args:
        path: of the file, or a binary stream.
        arrays: by name.
        stored: the kinds of dtype (NumPy's letters) that are not compressed. Floats shrink by a
            tenth only, and compressing 11 MB of them takes 0.25 s.

    Raises:
        ValueError: an array holds Python objects.
        OSError: the file cannot be written.
    """
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in arrays.items():
            entry = zipfile.ZipInfo(name + _SUFFIX, _FIXED_DATE)
            if array.dtype.kind not in stored:
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry._compresslevel = 1  # type: ignore[attr-defined]  # public only from Python 3.13 on
            with archive.open(entry, "w", force_zip64=True) as file:
                npy.write_array(file, np.asanyarray(array), allow_pickle=False)


def _entries(archive: zipfile.ZipFile, names: Iterable[str] | None) -> dict[str, zipfile.ZipInfo]:
    entries: dict[str, zipfile.ZipInfo] = {}
    for entry in archive.infolist():
        name = entry.filename.removesuffix(_SUFFIX)
        if name in entries:
            raise ValueError(f"it has the array {name!r} twice")
        if entry.compress_type not in _KINDS_OF_MEMBERS:
            raise ValueError(f"the array {name!r} is compressed by another method than deflate")
        entries[name] = entry
    return entries if names is None else {name: entries[name] for name in names}


def _array_header(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> ArrayHeader:
    with archive.open(entry) as member:
        return _parse_header(member, entry.file_size)


def _parse_header(member: IO[bytes], size: int) -> ArrayHeader:
    version = npy.read_magic(member)
    if version not in _HEADERS:
        raise ValueError(f"an array is in version {version} of numpy's format")
    with warnings.catch_warnings():
        # of headers that Python 2 wrote, which numpy reads with a warning
        warnings.simplefilter("ignore")
        shape, _, dtype = _HEADERS[version](member)
    if dtype.hasobject:
        raise ObjectArrayError("an array holds Python objects")
    if dtype.fields is not None or dtype.subdtype is not None or min(shape, default=0) < 0:
        raise ValueError(f"an array is of dtype {dtype} and shape {shape}")
    offset = member.tell()
    if math.prod(shape) * dtype.itemsize != size - offset:
        raise ValueError(
            f"an array of {size - offset} bytes should have {math.prod(shape) * dtype.itemsize}"
        )
    return ArrayHeader(dtype, shape)


def _array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> AnyArray:
    # the data end where the member ends, at which zipfile compares the checksum
    _array_header(archive, entry)
    with archive.open(entry) as member, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # as in _parse_header
        array: AnyArray = npy.read_array(member, allow_pickle=False)
    return array
