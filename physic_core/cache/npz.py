"""Named arrays and a JSON document in one npz file: no pickles, and there whole or not at all."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.io.atomic import replacing

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Arrays = dict[str, NDArray[Any]]

__all__ = ["Damaged", "read", "write"]

_DOCUMENT = "document"
_FAULTS = (
    *(OSError, EOFError, RuntimeError, MemoryError, ValueError, KeyError, TypeError),
    *(zipfile.BadZipFile, zlib.error),
)
"""What numpy, zipfile and json raise for files with flipped or missing bytes."""


class Damaged(Exception):
    """A file that is not whole, or not of this kind."""


def read(path: Path) -> tuple[Arrays, Any]:
    """The arrays and the document of a file.

    Raises:
        OSError: it is not there, or cannot be read.
        Damaged: it is not what :func:`write` wrote.
    """
    # Opened here: of a broken archive numpy forgets to close the file.
    with path.open("rb") as stream:
        try:
            with np.load(stream, allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
            return arrays, json.loads(arrays.pop(_DOCUMENT).tobytes())
        except _FAULTS as error:
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
