"""Named arrays and a JSON document in one npz file: no pickles, and there whole or not at all."""

from __future__ import annotations

import json
import stat
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.files.atomic import replacing
from physic_core.files.npz import read_arrays

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Arrays = dict[str, NDArray[Any]]

__all__ = ["Damaged", "read", "write"]

_DOCUMENT = "document"


class Damaged(Exception):
    """A file that is not whole, or not of this kind."""


def read(path: Path) -> tuple[Arrays, Any]:
    """The arrays and the document of a file, each checked against its checksum.

    Raises:
        OSError: it is not there, or cannot be read.
        Damaged: it is not what :func:`write` wrote.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise Damaged("it is no file")  # opening a pipe would wait for ever
    with path.open("rb") as stream:
        try:
            arrays = read_arrays(stream)
            return arrays, json.loads(arrays.pop(_DOCUMENT).tobytes())
        except Exception as error:  # zipfile, zlib, numpy and json raise a dozen classes for flipped and missing bytes
            raise Damaged(f"{type(error).__name__}: {error}") from error


def write(folder: Path, name: str, arrays: Mapping[str, NDArray[Any]], document: Any, *, squeeze: bool = True) -> None:
    """Write a file into ``folder``, which is made where it is missing.

    Args:
        folder: where to.
        name: of the file.
        arrays: by name.
        document: JSON-ready.
        squeeze: compress every array lightly: half the time of numpy's own for nearly the same size. Otherwise only
            masks and texts are: numbers shrink by little, and that costs more time than writing them.

    Raises:
        OSError, OutputError: the disk is full, or cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    text = np.frombuffer(json.dumps(document).encode(), np.uint8)
    with replacing(folder) as temporary, zipfile.ZipFile(temporary(name), "w", compresslevel=1) as archive:
        for key, array in {**arrays, _DOCUMENT: text}.items():
            pays = squeeze or array.dtype == bool or key == _DOCUMENT
            archive.compression = zipfile.ZIP_DEFLATED if pays else zipfile.ZIP_STORED
            with archive.open(f"{key}.npy", "w", force_zip64=True) as stream:
                np.lib.format.write_array(stream, np.asanyarray(array), allow_pickle=False)
